// The page of a shot that is simulated while it is looked at: sliders, the mouse as a hand and as
// breath. kit: what page.js has made.
"use strict";
async function live(kit) {
  const { header, state, first, byId } = kit;
  const panel = byId("panel");
  let version = header.version, newest = 0, before = null, grabbed = null, plane = null;
  Object.assign(state, { updates: 0, live: null, change, pull, letGo, blow, restart, save });

  async function send(name, content) {
    const answer = await fetch(name, { method: "POST", body: JSON.stringify(content) });
    const text = await answer.text();
    if (!answer.ok) {
      kit.told(text);
      throw new Error(text);
    }
    return JSON.parse(text);
  }

  // The newest of several changes of one kind is sent, as soon as the one before has arrived.
  const waiting = new Map(), busy = new Set();
  async function soon(name, key, content) {
    waiting.set(key, [name, content]);
    if (busy.has(key)) return;
    busy.add(key);
    try {
      while (waiting.has(key)) {
        const [where, what] = waiting.get(key);
        waiting.delete(key);
        await send(where, what);
      }
    } catch {
      waiting.delete(key); // it was told
    } finally {
      busy.delete(key);
    }
  }

  function change(key, value) { return soon("change", key, { key, value }); }
  function pull(feather, at, to) { return soon("pull", "pull", { feather, at, to }); }
  function letGo() { waiting.delete("pull"); return soon("pull", "pull", {}); }
  function blow(direction) { return soon("blow", "blow", direction ? { direction, speed: Number(byId("breath").value) } : {}); }
  function restart() { return send("restart", {}); }
  async function save() {
    const { written } = await send("save", {});
    kit.told(`written: ${written.join(", ")}`);
    return written;
  }

  // Sliders. scale: as of Slider in tuned.py; s: 0 to 1.
  const toValue = {
    linear: (s, [low, high]) => low + s * (high - low),
    factor: (s, [low, high]) => low * (high / low) ** s,
    cubic: (s, [low, high]) => low + s ** 3 * (high - low),
  };
  const toPlace = {
    linear: (v, [low, high]) => (v - low) / (high - low),
    factor: (v, [low, high]) => Math.log(Math.max(v, low) / low) / Math.log(high / low),
    cubic: (v, [low, high]) => Math.cbrt((v - low) / (high - low)),
  };
  const put = (tag, text, ...within) => {
    const made = document.createElement(tag);
    if (text) made.textContent = text;
    made.append(...within);
    return made;
  };

  function control(slider) {
    const name = slider.key.split(":")[1], unit = slider.unit ? ` (${slider.unit})` : "";
    const line = put("label", "", put("span", (name.split(".").slice(1).join(" ") || name).replaceAll("_", " ") + unit));
    line.title = `${name}: ${slider.meaning}`;
    line.dataset.key = slider.key;
    if (slider.kind === "choice") {
      const list = put("select");
      for (const each of slider.choices) list.add(new Option(each, each));
      list.value = slider.value;
      list.addEventListener("change", () => change(slider.key, list.value));
      line.append(list);
    } else if (slider.kind === "flag") {
      const box = put("input");
      Object.assign(box, { type: "checkbox", checked: slider.value });
      box.addEventListener("change", () => change(slider.key, box.checked));
      line.append(box);
    } else line.append(...numbers(slider));
    return line;
  }

  // As few characters as tell a number to six digits.
  function short(value) {
    const plain = String(Number(value.toPrecision(6))), power = Number(plain).toExponential();
    return plain.length > 8 ? power : plain;
  }

  function numbers(slider) {
    const way = put("input"), number = put("input"), { near, scale } = slider;
    Object.assign(way, { type: "range", min: 0, max: 1000 });
    Object.assign(number, { type: "number", step: "any", min: slider.low, max: slider.high, value: short(slider.value) });
    const place = (value) => { way.value = 1000 * Math.min(1, Math.max(0, toPlace[scale](value, near))); };
    place(slider.value);
    way.addEventListener("input", () => {
      const value = toValue[scale](way.value / 1000, near);
      number.value = slider.kind === "whole" ? Math.round(value) : short(Number(value.toPrecision(4)));
      change(slider.key, Number(number.value));
    });
    number.addEventListener("change", () => {
      place(Number(number.value));
      change(slider.key, Number(number.value));
    });
    way.addEventListener("dblclick", () => { // as it was
      number.value = short(slider.value);
      place(slider.value);
      change(slider.key, slider.value);
    });
    return [way, number];
  }

  const groups = new Map();
  for (const slider of header.sliders) {
    const [preset, name] = slider.key.split(":"), table = name.includes(".") ? name.split(".")[0] : "";
    const title = `${preset}${table ? ` ${table}` : ""}`;
    if (!groups.has(title)) groups.set(title, put("details", "", put("summary", title)));
    groups.get(title).append(control(slider));
  }
  panel.append(...groups.values());
  const opened = [...groups.keys()].find((title) => title.endsWith("vane_material"));
  for (const [title, group] of groups) group.open = title === opened || title.startsWith("wind/");

  // Frames as they come; the next is asked for before the last is drawn.
  const valueShown = () => header.values.find((each) => each.name === kit.mode())?.name || "points";
  let asked = null;
  function ask() {
    const value = valueShown(), answer = fetch(`${value}-after-${newest}`, { cache: "no-store" });
    answer.catch(() => {}); // it is heard of where it is waited for
    return { value, answer };
  }

  async function next() {
    const { value, answer: coming } = asked || ask(), answer = await coming;
    asked = null;
    if (!answer.ok) throw new Error(await answer.text());
    const buffer = await answer.arrayBuffer(), size = new DataView(buffer).getUint32(0, true);
    const now = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, size)));
    newest = now.number;
    if (now.version !== version) {
      Object.assign(header, await (await fetch("header", { cache: "no-store" })).json());
      version = header.version;
      before = null;
      await first.refresh();
      return;
    }
    asked = ask();
    const found = unpacked(header.points, buffer, 4 + size);
    if (value !== "points") found.values[value] = new Uint8Array(buffer, 28 + size + 6 * header.points, header.points);
    if (kit.mode() === "velocity") {
      const seconds = before ? now.time - before.time : 0;
      found.speeds = seconds > 0 ? kit.speedsBetween(pointsOf(before.found), pointsOf(found), seconds) : new Float32Array(header.points);
    }
    before = { time: now.time, found };
    kit.settle();
    first.put(found);
    if (value === valueShown()) kit.paint(first, found);
    kit.draw();
    state.live = now;
    state.updates++;
    if (now.problem !== state.told) kit.told((state.told = now.problem));
  }

  // Updates a second, of the last second, in the bar.
  let since = performance.now(), counted = 0;
  function tell() {
    const now = performance.now();
    if (now - since < 500) return;
    state.rate = (1000 * (state.updates - counted)) / (now - since);
    [since, counted] = [now, state.updates];
    const { time, energy, iterations, milliseconds } = state.live, micro = (each) => `${(1e6 * each).toPrecision(3)}`;
    byId("number").textContent = `${time.toFixed(2)} s`;
    byId("numbers").textContent = [
      `${state.rate.toFixed(0)} updates a second, ${milliseconds.toFixed(1)} ms each`,
      `iterations ${iterations.toFixed(1)} a feather`,
      `energy in µJ: kinetic ${micro(energy.kinetic)}, elastic ${micro(energy.elastic)}, of gravity ${micro(energy.height)}`,
    ].join("\n");
    kit.showKey();
  }

  async function loop() {
    for (;;) {
      try {
        await next();
        if (state.live) tell();
      } catch (error) {
        state.problem = String(error.message || error);
        kit.told(`${state.problem}; the server does not answer, load the page again when it does`);
        return;
      }
    }
  }

  // The hand: a feather that is pressed is pulled, across the view.
  const canvas = kit.renderer.domElement;
  const onPlane = (event) => {
    const to = new THREE.Vector3();
    return kit.rayAt(event.clientX, event.clientY).ray.intersectPlane(plane, to) ? to.toArray() : null;
  };
  canvas.addEventListener("pointerdown", (event) => {
    const hit = event.button === 0 && !event.shiftKey ? kit.under(event.clientX, event.clientY) : null;
    if (!hit) return;
    state.pick(event.clientX, event.clientY);
    grabbed = { feather: hit.feather, at: hit.point.toArray() };
    plane = new THREE.Plane().setFromNormalAndCoplanarPoint(kit.camera.getWorldDirection(new THREE.Vector3()), hit.point);
    canvas.setPointerCapture(event.pointerId);
    event.stopImmediatePropagation(); // the view does not turn
  }, { capture: true });
  canvas.addEventListener("pointermove", (event) => {
    const to = grabbed && onPlane(event);
    if (to) pull(grabbed.feather, grabbed.at, to);
  });
  canvas.addEventListener("pointerup", () => {
    if (grabbed) letGo();
    grabbed = null;
  });

  // Breath: along the view, while the key or the button is held.
  const breathe = (on) => blow(on ? kit.camera.getWorldDirection(new THREE.Vector3()).toArray() : null);
  addEventListener("keydown", (event) => { if (event.key === "b" && !event.repeat && event.target.type !== "number") breathe(true); });
  addEventListener("keyup", (event) => { if (event.key === "b") breathe(false); });
  byId("blow").addEventListener("pointerdown", () => breathe(true));
  for (const end of ["pointerup", "pointerleave"]) byId("blow").addEventListener(end, () => breathe(false));
  byId("restart").addEventListener("click", restart);
  byId("save").addEventListener("click", () => save().catch(() => {}));
  byId("speed").addEventListener("change", (event) => send("speed", { speed: Number(event.target.value) }));

  await next();
  loop();
}
