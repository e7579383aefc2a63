// Plays a cache: frames come from the page itself (base64 of gzip) or from the server beside it.
"use strict";
(async () => {
  const header = JSON.parse(document.getElementById("header").textContent);
  const byId = (id) => document.getElementById(id);
  const told = (text) => { byId("told").textContent = text; };
  const state = (window.featherfx = {
    frames: header.frames.length, frame: 0, feathers: header.feathers, ready: false, playing: false,
    header, setFrame, setColour, pick, problem: "", triangles: header.triangles, spare: 30, drawing: 0, few: 10000,
  });

  async function embedded(name) {
    const text = byId(`data-${name}`).textContent.trim();
    const packed = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(stream).arrayBuffer();
  }

  async function served(name) {
    const answer = await fetch(name, { cache: "no-store" });
    if (!answer.ok) throw new Error(await answer.text());
    return answer.arrayBuffer();
  }

  const load = header.embedded ? embedded : served;

  const toLight = (c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
  function table(ramp) {
    const colours = new Float32Array(256 * 3);
    for (let k = 0; k < 256; k++) {
      const at = (k / 255) * (ramp.length - 1), low = Math.min(Math.floor(at), ramp.length - 2);
      for (let c = 0; c < 3; c++) {
        colours[3 * k + c] = toLight(ramp[low][c] + (at - low) * (ramp[low + 1][c] - ramp[low][c]));
      }
    }
    return colours;
  }

  // The scene.
  const BASES = ["pattern", "region", "barb angle at rest"];
  const material = new THREE.MeshLambertMaterial({ vertexColors: true, side: THREE.DoubleSide, flatShading: true });
  const kit = { load, material, bases: BASES };
  const first = shownCache(header, "", kit), second = header.second ? shownCache(header.second, "second-", kit) : null;
  const shown = second ? [first, second] : [first];
  await Promise.all(shown.map((each) => each.refresh()));
  const inBoth = (name) => shown.every((each) => each.header.values.some((v) => v.name === name));
  const modes = [...BASES, ...header.values.map((v) => v.name).filter(inBoth)];
  if (state.frames > 1 || header.live) modes.push("velocity");
  if (second && header.alike) modes.push("difference");
  const ramps = Object.fromEntries(header.values.map((v) => [v.name, table(v.ramp)]));
  ramps.velocity = ramps.difference = table(header.ramp);
  if (header.angles) ramps[BASES[2]] = ramps.velocity;

  // The address may say what draws: page.html#webgl, page.html#software.
  function hasCard() {
    if (["#webgl", "#software"].includes(location.hash)) return location.hash === "#webgl";
    const probe = document.createElement("canvas").getContext("webgl2"), info = probe?.getExtension("WEBGL_debug_renderer_info");
    return probe && !(info && /swiftshader|llvmpipe|software/i.test(probe.getParameter(info.UNMASKED_RENDERER_WEBGL)));
  }
  const renderer = hasCard() ? new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true }) : softwareRenderer();
  renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
  document.body.prepend(renderer.domElement);
  const scene = new THREE.Scene();
  scene.background = new THREE.Color(0x4a4f57);
  const camera = new THREE.PerspectiveCamera(35, 1, 0.001, 1000);
  camera.up.set(0, 0, 1);
  const sky = new THREE.HemisphereLight(0xe8eefc, 0x6b5c4c, 1.6);
  sky.position.set(0, 0, 1);
  scene.add(sky);
  const sun = new THREE.DirectionalLight(0xfff3e0, 2.2);
  camera.add(sun);
  sun.position.set(1, 1.5, 2);
  scene.add(camera);
  const bodies = shown.map((each) => each.body).filter(Boolean);
  [...shown, ...bodies].forEach((each) => scene.add(each.mesh));
  const controls = new THREE.OrbitControls(camera, renderer.domElement);
  controls.addEventListener("change", draw);

  // Width of the view, beside the panel of sliders.
  const width = () => innerWidth - byId("panel").offsetWidth;

  // Two caches stand side by side in one camera, but for their difference, which the first shows.
  const halves = () => (second && mode !== "difference" ? [first, second] : [first]);

  let drawnStep = 0; // of those below
  // A body of many triangles waits until what is drawn slowly stands.
  const showsBody = (body) => byId("body").checked && !(drawnStep && body.header.triangles > 5 * state.few);

  function draw() {
    const drawn = halves(), wide = width() / drawn.length;
    renderer.setScissorTest(drawn.length > 1);
    drawn.forEach((each, k) => {
      shown.forEach((other) => {
        other.mesh.visible = other === each;
        if (other.body) other.body.mesh.visible = other === each && showsBody(other.body);
      });
      renderer.setViewport(k * wide, 0, wide, innerHeight);
      renderer.setScissor(k * wide, 0, wide, innerHeight);
      renderer.render(scene, camera);
    });
  }

  // Half the resolution and fewer triangles while it moves, where drawing takes more than
  // state.spare ms, or less but so much that it plays slower than it should, step by step, with a
  // try of the step before where there is time to spare; all where it stands. One frame of some is
  // timed, to its end; the first sets drawing up. Below state.few triangles fewer bring nothing.
  const pixel = new Uint8Array(4);
  let untimed = 1, patience = 12, trying = false, step = 0, aimed = 0; // aimed: the level of the next frame
  let since = 0, passed = 0; // when frames began to be counted, and how many came
  function drawMoving() {
    passed++;
    if (untimed-- > 0) return draw();
    const gl = renderer.getContext?.(), began = performance.now();
    draw();
    gl?.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    state.drawing = performance.now() - began;
    untimed = patience;
    const pace = (began - since) / passed, isLate = state.playing && since && pace > 1.1 * frameTime() && state.drawing > 0.25 * pace;
    [since, passed] = [began, 0];
    if ((isLate || state.drawing > state.spare) && step < steps()) {
      const each = state.drawing / worked(first.level), spare = Math.min(state.spare, 0.7 * state.drawing);
      do step++; while (step < steps() && each * worked(Math.min(step, most())) > spare);
      patience = trying ? Math.min(2 * patience, 400) : patience;
      untimed = trying ? patience : 1;
      trying = false;
    } else if (step && state.drawing < 0.5 * state.spare) {
      step--;
      trying = true;
      untimed = 1;
    } else trying = false;
    aimed = Math.min(step, most());
  }
  // The level of the fewest triangles that bring something, and steps: one where that is the first.
  const most = () => {
    const found = first.levels.findIndex((each) => each.triangles <= state.few);
    return found < 0 ? first.levels.length - 1 : found;
  };
  const steps = () => Math.max(1, most());
  // ms from frame to frame, of those that can be seen
  const frameTime = () => Math.max(1000 / (Number(byId("speed").value) * header.framesPerSecond), 1000 / 24);
  const trianglesDrawn = (level) => halves().reduce((sum, each) => sum + each.levels[Math.min(level, each.levels.length - 1)].triangles, 0);

  // All triangles that are drawn, those of bodies too, which have one level.
  const worked = (level) => halves().reduce((sum, { body }) => sum + (body && showsBody(body) ? body.header.triangles : 0), trianglesDrawn(level));

  // The step that is drawn next, before its points are put.
  function settle() {
    const now = state.playing || header.live ? step : 0;
    aimed = Math.min(now, most());
    if (now === drawnStep && first.level === aimed) return;
    drawnStep = now;
    shown.forEach((each) => each.draws(aimed));
    renderer.setPixelRatio(Math.min(devicePixelRatio, 2) * (now ? 0.5 : 1));
    state.triangles = trianglesDrawn(aimed);
    const told = aimed ? ` and ${state.triangles} of ${trianglesDrawn(0)} triangles` : "";
    byId("few").textContent = now ? `drawn with half the resolution${told} while it moves, since this machine draws slowly` : "";
  }
  // The level that is asked of a server; what changes with frames has values of all points.
  const levelAsked = (own) => (state.playing && !header.embedded && mode in own.base ? Math.min(aimed, own.levels.length - 1) : 0);

  function resize() {
    camera.aspect = width() / halves().length / innerHeight;
    camera.updateProjectionMatrix();
    renderer.setSize(width(), innerHeight);
    draw();
  }

  // All of what is looked at: feathers, and of the body what the camera is to see.
  function lookAtAll() {
    const body = byId("body").checked && first.body;
    look([first, 0, header.points], ...(body ? [[body, 0, body.header.framed]] : []));
  }

  // A box around runs of points, each of a cache or a body, seen from where most vanes are seen.
  function look(...runs) {
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    const p = new THREE.Vector3();
    for (const [own, begin, count] of runs)
      for (let k = begin; k < begin + count; k++) {
        own.point(k, p).toArray().forEach((value, c) => {
          if (value < low[c]) low[c] = value;
          if (value > high[c]) high[c] = value;
        });
      }
    const size = Math.hypot(high[0] - low[0], high[1] - low[1], high[2] - low[2]) || 1;
    controls.target.set(...low.map((value, k) => 0.5 * (value + high[k])));
    const way = new THREE.Vector3(...header.from), away = nearest(runs, way, size);
    camera.position.copy(controls.target).add(way.multiplyScalar(away));
    camera.near = size / 1000;
    camera.far = 100 * size;
    camera.updateProjectionMatrix();
    controls.update();
    draw();
  }

  // How near a camera may come that still sees these points, with a margin for the bar below.
  function nearest(runs, way, size) {
    const right = new THREE.Vector3(0, 0, 1).cross(way).normalize(), up = way.clone().cross(right);
    const room = header.live ? 0.6 : 0.84; // what is shaken needs more
    const high = Math.tan((Math.PI / 180) * 0.5 * camera.fov) * room, wide = high * camera.aspect, p = new THREE.Vector3();
    let away = 0.01 * size;
    for (const [own, begin, count] of runs)
      for (let k = begin; k < begin + count; k++) {
        own.point(k, p).sub(controls.target);
        away = Math.max(away, p.dot(way) + Math.max(Math.abs(p.dot(right)) / wide, Math.abs(p.dot(up)) / high));
      }
    return away;
  }

  // The camera goes along with the middle of the feathers, where that is asked for.
  let middle = null;
  const middleOf = ({ box }) => new THREE.Vector3(...[0, 1, 2].map((c) => box[c] + 0.5 * box[3 + c]));
  function follow(found) {
    const now = middleOf(found);
    if (middle && byId("follow").checked) {
      const move = now.clone().sub(middle);
      controls.target.add(move);
      camera.position.add(move);
      camera.updateMatrixWorld();
    }
    middle = now;
  }

  // What goes farther than it is large leaves the view otherwise.
  async function followWhatGoesFar() {
    if (state.frames < 2 || state.problem) return;
    const begin = await first.frameOf(0), end = await first.frameOf(state.frames - 1);
    byId("follow").checked = middleOf(begin).distanceTo(middleOf(end)) > Math.hypot(...begin.box.slice(3));
  }

  // Frames and colours. fastest, farthest: m/s and mm that were met with so far.
  let mode = "pattern", fastest = 1e-6, farthest = 1e-6;
  const isValue = (name) => header.values.some((each) => each.name === name);
  const ofSecond = (number) => {
    const code = header.frames[number], codes = header.second.frames;
    const nearby = codes.map((each) => Math.abs(each - code));
    return nearby.indexOf(Math.min(...nearby));
  };

  async function setFrame(number) {
    const wanted = Math.max(0, Math.min(state.frames - 1, Math.round(number)));
    state.wanted = wanted;
    let found, stands;
    try {
      const asked = [first.frameOf(wanted, levelAsked(first)), ...(second ? [second.frameOf(ofSecond(wanted), levelAsked(second))] : [])];
      found = await Promise.all(asked);
      stands = await Promise.all(bodies.map((each) => each.frameOf(each === second?.body ? ofSecond(wanted) : wanted)));
      for (const [k, each] of found.entries()) {
        const number = k ? ofSecond(wanted) : wanted;
        if (mode === "velocity") each.speeds = each.speeds || (await speedsOf(shown[k], number));
        else if (isValue(mode)) await shown[k].value(each, mode, number);
      }
    } catch (error) {
      state.problem = String(error.message || error);
      state.playing = false;
      byId("play").textContent = "play";
      told(state.problem);
      return state.frame;
    }
    if (state.wanted !== wanted) return state.frame; // another one was asked for meanwhile
    settle();
    if (shown.some((each, k) => found[k].level !== 0 && found[k].level !== each.level)) return setFrame(wanted);
    shown.forEach((each, k) => each.put(found[k]));
    bodies.forEach((each, k) => { each.put(stands[k]); paint(each, stands[k], "pattern"); });
    follow(found[0]);
    if (mode === "difference") found[0].apart = apart(found);
    shown.forEach((each, k) => paint(each, found[k]));
    showKey();
    state.frame = wanted;
    state.drawn = (state.drawn || 0) + 1;
    byId("time").value = wanted;
    const code = header.frames[wanted];
    byId("number").textContent = code === null ? "at rest" : `frame ${code}`;
    mark();
    if (state.playing) drawMoving();
    else draw();
    return wanted;
  }

  // Metres per second, from the frame before to the one after.
  async function speedsOf(own, number) {
    const before = Math.max(0, number - 1), after = Math.min(own.header.frames.length - 1, number + 1);
    const [low, high] = [await own.frameOf(before), await own.frameOf(after)];
    return speedsBetween(pointsOf(low), pointsOf(high), (after - before) / own.header.framesPerSecond || 1);
  }

  function speedsBetween(low, high, seconds) {
    const speeds = distances(low, high).map((each) => each / seconds);
    for (const each of speeds) if (each > fastest) fastest = each;
    return speeds;
  }

  // Millimetres between the same points of both caches.
  function apart(found) {
    const far = distances(pointsOf(found[0]), pointsOf(found[1])).map((each) => 1000 * each);
    for (const each of far) if (each > farthest) farthest = each;
    state.farthest = far.reduce((most, each) => Math.max(most, each), 0);
    return far;
  }

  function distances(one, other) {
    const far = new Float32Array(one.length / 3);
    for (let k = 0; k < far.length; k++) {
      far[k] = Math.hypot(one[3 * k] - other[3 * k], one[3 * k + 1] - other[3 * k + 1], one[3 * k + 2] - other[3 * k + 2]);
    }
    return far;
  }

  function paint(own, found, by = mode) {
    if (by in own.base && own.painted === by) return; // it does not change
    own.painted = by;
    const { chosen, points, colour } = own.levels[own.level], out = colour.array;
    const from = own.base[by] || ramps[by], scale = by in own.base ? 1 : 255;
    const [numbers, most] = by === "velocity" ? [found.speeds, fastest] : [found.apart, farthest];
    const bytes = found.values[by];
    for (let k = 0; k < points; k++) {
      const point = chosen ? chosen[k] : k;
      let at = point;
      if (scale > 1) at = bytes ? bytes[point] : numbers ? Math.round((255 * numbers[point]) / most) : 0;
      for (let c = 0; c < 3; c++) out[4 * k + c] = scale * from[3 * at + c];
    }
    colour.needsUpdate = true;
  }

  async function setColour(name) {
    if (!modes.includes(name)) throw new Error(`${name} is not one of ${modes.join(", ")}`);
    mode = name;
    byId("colour").value = name;
    resize();
    return setFrame(state.frame);
  }

  function showKey() {
    const key = byId("key");
    key.replaceChildren();
    if (mode === "region") {
      for (const region of header.regions) {
        const feather = header.feathers.find((f) => f.region === region), line = document.createElement("div");
        const swatch = document.createElement("i"), c = [0, 1, 2].map((k) => first.base.region[3 * feather.first + k] / 255);
        swatch.style.background = `#${new THREE.Color(...c).getHexString()}`;
        line.append(swatch, region || "(none)");
        key.append(line);
      }
    } else if (mode in ramps) {
      const value = header.values.find((v) => v.name === mode);
      const strip = document.createElement("canvas"), ramp = ramps[mode];
      strip.width = 256;
      strip.height = 1;
      const paper = strip.getContext("2d");
      for (let k = 0; k < 256; k++) {
        paper.fillStyle = `#${new THREE.Color(ramp[3 * k], ramp[3 * k + 1], ramp[3 * k + 2]).getHexString()}`;
        paper.fillRect(k, 0, 1, 1);
      }
      const upTo = (most) => `0 to ${most.toPrecision(2)}`;
      const others = {
        velocity: ["velocity (m/s)", upTo(fastest)], difference: ["difference (mm)", upTo(farthest)],
        [BASES[2]]: ["angle of barbs at rest (degrees)", header.angles?.map((each) => each.toFixed(0)).join(" to ")],
      };
      const [title, ends] = value ? [value.title, value.ends] : others[mode];
      const line = document.createElement("div");
      line.textContent = ends;
      key.append(title, document.createElement("br"), strip, line);
    }
  }

  // Picking: the feather below a place of the window.
  let picked = -1;
  function pick(x, y) {
    const hit = under(x, y);
    picked = hit ? hit.feather : -1;
    mark();
    return picked < 0 ? null : header.feathers[picked];
  }

  // Number of the feather below a place, and the point of it.
  function under(x, y) {
    const drawn = halves(), wide = width() / drawn.length, half = Math.min(Math.floor(x / wide), drawn.length - 1);
    const ray = rayAt(x - half * wide, y), { body } = drawn[half];
    const [hit] = ray.intersectObject(drawn[half].mesh);
    if (!hit) return null;
    if (body && showsBody(body) && ray.intersectObject(body.mesh)[0]?.distance < hit.distance) return null;
    const name = drawn[half].header.feathers[ownerOf(drawn[half].header, drawn[half].pointOf(hit.face.a))].id;
    const feather = header.feathers.findIndex((each) => each.id === name);
    return feather < 0 ? null : { feather, point: hit.point };
  }

  function rayAt(x, y) {
    const ray = new THREE.Raycaster(), wide = width() / halves().length;
    ray.setFromCamera(new THREE.Vector2((2 * x) / wide - 1, 1 - (2 * y) / innerHeight), camera);
    return ray;
  }

  function ownerOf(header, point) {
    let low = 0, high = header.feathers.length - 1;
    while (low < high) {
      const middle = Math.ceil((low + high) / 2);
      if (header.feathers[middle].first <= point) low = middle;
      else high = middle - 1;
    }
    return low;
  }

  function ends(index) {
    const next = header.feathers[index + 1];
    return [header.feathers[index].first, next ? next.first : header.points];
  }

  function mark() {
    if (picked < 0) {
      byId("picked").textContent = "";
      return;
    }
    const own = header.feathers[picked], [first, end] = ends(picked);
    byId("picked").textContent = [own.id, `kind: ${own.kind}`, `region: ${own.region || "(none)"}`,
      `length: ${(1000 * own.length).toPrecision(4)} mm`, `root at rest: ${own.root.join(", ")} m`,
      `points: ${own.points}${end - first < own.points ? `, ${end - first} drawn` : ""}`].join("\n");
  }

  // Controls.
  let pressed = null;
  renderer.domElement.addEventListener("pointerdown", (event) => { pressed = [event.clientX, event.clientY]; });
  renderer.domElement.addEventListener("pointerup", (event) => {
    if (pressed && Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < 4) pick(event.clientX, event.clientY);
  });
  if (second) byId("names").textContent = `left: ${header.name}, right: ${header.second.name}`;
  for (const name of modes) byId("colour").add(new Option(name, name));
  byId("colour").addEventListener("change", (event) => setColour(event.target.value));
  byId("time").max = state.frames - 1;
  byId("time").addEventListener("input", (event) => setFrame(Number(event.target.value)));
  byId("home").addEventListener("click", lookAtAll);
  byId("body").addEventListener("change", draw);
  byId("ofbody").hidden = !bodies.length;
  byId("following").hidden = header.live || state.frames < 2;
  byId("play").addEventListener("click", toggle);
  addEventListener("resize", resize);
  addEventListener("keydown", (event) => {
    if (event.target.tagName === "SELECT" || event.target.type === "number") return;
    if (event.key === " ") { event.preventDefault(); toggle(); }
    else if (event.key === "ArrowRight") setFrame(state.frame + 1);
    else if (event.key === "ArrowLeft") setFrame(state.frame - 1);
    else if (event.key === "h") lookAtAll();
    else if (event.key === "f" && picked >= 0) look([first, ends(picked)[0], ends(picked)[1] - ends(picked)[0]]);
  });

  let begun = 0, from = 0, busy = false;
  function toggle() {
    state.playing = !state.playing && state.frames > 1;
    byId("play").textContent = state.playing ? "stop" : "play";
    begun = performance.now();
    from = state.frame;
    since = 0;
    if (state.playing) requestAnimationFrame(tick);
    else setFrame(state.frame); // in full
  }

  async function tick(now) {
    if (!state.playing) return;
    const speed = Number(byId("speed").value) * header.framesPerSecond;
    const wanted = (from + Math.floor(((now - begun) / 1000) * speed)) % state.frames;
    if (!busy && wanted !== state.frame) {
      busy = true;
      const far = Math.min(Math.max((wanted - state.frame + state.frames) % state.frames, 1), 12);
      await setFrame(wanted);
      const next = (wanted + far) % state.frames; // ahead, as far as it went this time
      shown.forEach((each, k) => each.frameOf(k ? ofSecond(next) : next, levelAsked(each)).catch(() => {}));
      busy = false;
    }
    requestAnimationFrame(tick);
  }

  byId("about").textContent = `${header.feathers.length} feather${header.feathers.length > 1 ? "s" : ""}` + (header.live ? ", live" : `, ${state.frames} frame${state.frames > 1 ? "s" : ""}`);
  byId("hint").textContent = header.live
    ? "drag a feather to pull it, beside it or with shift to turn; wheel: zoom, b: blow, f: frame the feather, h: all"
    : "drag: turn, right drag: move, wheel: zoom, click: pick a feather, space: play, arrows: step, f: frame the feather, h: all";
  told(header.told);
  if (header.live) {
    document.body.classList.add("live");
    resize();
    await live({ header, state, first, byId, told, draw: drawMoving, settle, paint, showKey, speedsBetween, under, rayAt, camera, controls, renderer, mode: () => mode });
  } else {
    await setFrame(0);
    await followWhatGoesFar();
  }
  resize();
  lookAtAll();
  state.ready = !state.problem;
})().catch((error) => {
  document.getElementById("told").textContent = `This page cannot be shown: ${error.message}`;
  window.featherfx = { ...(window.featherfx || {}), ready: false, problem: String(error.message) };
});
