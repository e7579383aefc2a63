// Plays a cache: frames come from the page itself (base64 of gzip) or from the server beside it.
"use strict";
(async () => {
  const header = JSON.parse(document.getElementById("header").textContent);
  const byId = (id) => document.getElementById(id);
  const told = (text) => { byId("told").textContent = text; };
  const state = (window.featherfx = {
    frames: header.frames.length, frame: 0, feathers: header.feathers, ready: false, playing: false,
    header, setFrame, setColour, pick, problem: "",
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

  // A cache as it is shown: its frames, of which those that were played last stay in memory, and
  // its mesh. prefix: of its names at the server.
  function shownCache(header, prefix) {
    const kept = new Map();
    async function frameOf(number) {
      if (!kept.has(number)) {
        kept.set(number, load(`${prefix}frame-${number}`).then((buffer) => unpacked(header, buffer, 0)));
        const most = Math.max(8, Math.floor(header.keptBytes / (6 * header.points)));
        while (kept.size > most) kept.delete(kept.keys().next().value);
      }
      const found = kept.get(number);
      kept.delete(number);
      kept.set(number, found);
      try {
        return await found;
      } catch (error) {
        kept.delete(number);
        throw error;
      }
    }
    const geometry = new THREE.BufferGeometry();
    const mesh = new THREE.Mesh(geometry, material);
    mesh.frustumCulled = false;
    const own = { header, geometry, mesh, frameOf, base: {}, position: null, colour: null, painted: "" };
    own.refresh = async () => {
      const constant = await load(`${prefix}constant`);
      BASES.forEach((name, k) => {
        own.base[name] = new Uint8Array(constant, 12 * header.triangles + 3 * k * header.points, 3 * header.points);
      });
      own.position = new THREE.BufferAttribute(new Uint16Array(3 * header.points), 3, true);
      own.painted = "";
      own.colour = new THREE.BufferAttribute(new Float32Array(3 * header.points), 3);
      own.position.usage = own.colour.usage = 35048; // changes often
      geometry.setAttribute("position", own.position);
      geometry.setAttribute("color", own.colour);
      geometry.setIndex(new THREE.BufferAttribute(new Uint32Array(constant, 0, 3 * header.triangles), 1));
      kept.clear();
    };
    // A value of a frame, which comes when a colour asks for it.
    own.value = async (found, name, number) => {
      found.values[name] = found.values[name] || new Uint8Array(await load(`${prefix}${name}-${number}`));
    };
    // Places in the box of a frame are drawn as they are; the mesh has its size.
    own.put = (found) => {
      own.position.array.set(found.places);
      own.position.needsUpdate = true;
      mesh.position.fromArray(found.box);
      mesh.scale.fromArray(found.box, 3);
      mesh.updateMatrixWorld();
      geometry.boundingSphere = null;
    };
    own.point = (k, to) => to.fromBufferAttribute(own.position, k).applyMatrix4(mesh.matrixWorld);
    return own;
  }

  // A frame that begins somewhere in a buffer, and room for values by name.
  function unpacked(header, buffer, begin) {
    const box = new Float32Array(buffer, begin, 6), places = new Uint16Array(buffer, begin + 24, 3 * header.points);
    return { box, places, values: {} };
  }

  // Its points, which only distances need.
  function pointsOf({ box, places }) {
    const points = new Float32Array(places.length);
    for (let c = 0; c < 3; c++) {
      const start = box[c], size = box[3 + c] / 65535;
      for (let k = c; k < points.length; k += 3) points[k] = start + places[k] * size;
    }
    return points;
  }

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
  const first = shownCache(header, ""), second = header.second ? shownCache(header.second, "second-") : null;
  const shown = second ? [first, second] : [first];
  await Promise.all(shown.map((each) => each.refresh()));
  const inBoth = (name) => shown.every((each) => each.header.values.some((v) => v.name === name));
  const modes = [...BASES, ...header.values.map((v) => v.name).filter(inBoth)];
  if (state.frames > 1 || header.live) modes.push("velocity");
  if (second && header.alike) modes.push("difference");
  const ramps = Object.fromEntries(header.values.map((v) => [v.name, table(v.ramp)]));
  ramps.velocity = ramps.difference = table(header.ramp);

  // Without a graphics card smooth edges take more time than all else.
  function hasCard() {
    const probe = document.createElement("canvas").getContext("webgl2"), info = probe?.getExtension("WEBGL_debug_renderer_info");
    return !(info && /swiftshader|llvmpipe|software/i.test(probe.getParameter(info.UNMASKED_RENDERER_WEBGL)));
  }
  const renderer = new THREE.WebGLRenderer({ antialias: hasCard(), preserveDrawingBuffer: true });
  renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
  document.body.prepend(renderer.domElement);
  const scene = new THREE.Scene();
  scene.background = new THREE.Color(0x4a4f57);
  const camera = new THREE.PerspectiveCamera(35, 1, 0.001, 1000);
  camera.up.set(0, 0, 1);
  scene.add(new THREE.HemisphereLight(0xe8eefc, 0x6b5c4c, 1.6));
  const sun = new THREE.DirectionalLight(0xfff3e0, 2.2);
  camera.add(sun);
  sun.position.set(1, 1.5, 2);
  scene.add(camera);
  shown.forEach((each) => scene.add(each.mesh));
  const controls = new THREE.OrbitControls(camera, renderer.domElement);
  controls.addEventListener("change", draw);

  // Width of the view, beside the panel of sliders.
  const width = () => innerWidth - byId("panel").offsetWidth;

  // Two caches stand side by side in one camera, but for their difference, which the first shows.
  const halves = () => (second && mode !== "difference" ? [first, second] : [first]);

  function draw() {
    const drawn = halves(), wide = width() / drawn.length;
    renderer.setScissorTest(drawn.length > 1);
    drawn.forEach((each, k) => {
      shown.forEach((other) => { other.mesh.visible = other === each; });
      renderer.setViewport(k * wide, 0, wide, innerHeight);
      renderer.setScissor(k * wide, 0, wide, innerHeight);
      renderer.render(scene, camera);
    });
  }

  function resize() {
    camera.aspect = width() / halves().length / innerHeight;
    camera.updateProjectionMatrix();
    renderer.setSize(width(), innerHeight);
    draw();
  }

  // A box around some points, seen from the front, left and above.
  function look(begin, count) {
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    const p = new THREE.Vector3();
    for (let k = begin; k < begin + count; k++) {
      first.point(k, p).toArray().forEach((value, c) => {
        if (value < low[c]) low[c] = value;
        if (value > high[c]) high[c] = value;
      });
    }
    const size = Math.hypot(high[0] - low[0], high[1] - low[1], high[2] - low[2]) || 1;
    controls.target.set(...low.map((value, k) => 0.5 * (value + high[k])));
    const way = new THREE.Vector3(...header.from), away = nearest(begin, count, way, size);
    camera.position.copy(controls.target).add(way.multiplyScalar(away));
    camera.near = size / 1000;
    camera.far = 100 * size;
    camera.updateProjectionMatrix();
    controls.update();
    draw();
  }

  // How near a camera may come that still sees these points, with a margin for the bar below.
  function nearest(begin, count, way, size) {
    const right = new THREE.Vector3(0, 0, 1).cross(way).normalize(), up = way.clone().cross(right);
    const high = Math.tan((Math.PI / 180) * 0.5 * camera.fov) * 0.84, wide = high * camera.aspect, p = new THREE.Vector3();
    let away = 0.01 * size;
    for (let k = begin; k < begin + count; k++) {
      first.point(k, p).sub(controls.target);
      away = Math.max(away, p.dot(way) + Math.max(Math.abs(p.dot(right)) / wide, Math.abs(p.dot(up)) / high));
    }
    return away;
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
    let found;
    try {
      const asked = [first.frameOf(wanted), ...(second ? [second.frameOf(ofSecond(wanted))] : [])];
      found = await Promise.all(asked);
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
    shown.forEach((each, k) => each.put(found[k]));
    if (mode === "difference") found[0].apart = apart(found);
    shown.forEach((each, k) => paint(each, found[k]));
    showKey();
    state.frame = wanted;
    state.drawn = (state.drawn || 0) + 1;
    byId("time").value = wanted;
    const code = header.frames[wanted];
    byId("number").textContent = code === null ? "at rest" : `frame ${code}`;
    mark();
    draw();
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

  function paint(own, found) {
    if (mode in own.base && own.painted === mode) return; // it does not change
    own.painted = mode;
    const out = own.colour.array, ramp = ramps[mode];
    if (mode in own.base) {
      const from = own.base[mode];
      for (let k = 0; k < out.length; k++) out[k] = from[k] / 255;
    } else {
      const [values, most] = mode === "velocity" ? [found.speeds, fastest] : [found.apart, farthest];
      for (let k = 0; k < own.header.points; k++) {
        const at = mode in found.values ? found.values[mode][k] : values ? Math.round((255 * values[k]) / most) : 0;
        for (let c = 0; c < 3; c++) out[3 * k + c] = ramp[3 * at + c];
      }
    }
    own.colour.needsUpdate = true;
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
      const others = { velocity: ["velocity (m/s)", fastest], difference: ["difference (mm)", farthest] };
      const [title, most] = value ? [value.title, value.high] : others[mode], ends = [value ? value.low : 0, most];
      const line = document.createElement("div");
      line.textContent = `${ends[0].toPrecision(2)} to ${ends[1].toPrecision(2)}`;
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
    const ray = rayAt(x - half * wide, y);
    const [hit] = ray.intersectObject(drawn[half].mesh);
    if (!hit) return null;
    const name = drawn[half].header.feathers[ownerOf(drawn[half].header, hit.face.a)].id;
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
  byId("home").addEventListener("click", () => look(0, header.points));
  byId("play").addEventListener("click", toggle);
  addEventListener("resize", resize);
  addEventListener("keydown", (event) => {
    if (event.target.tagName === "SELECT" || event.target.type === "number") return;
    if (event.key === " ") { event.preventDefault(); toggle(); }
    else if (event.key === "ArrowRight") setFrame(state.frame + 1);
    else if (event.key === "ArrowLeft") setFrame(state.frame - 1);
    else if (event.key === "h") look(0, header.points);
    else if (event.key === "f" && picked >= 0) look(ends(picked)[0], ends(picked)[1] - ends(picked)[0]);
  });

  let begun = 0, from = 0, busy = false;
  function toggle() {
    state.playing = !state.playing && state.frames > 1;
    byId("play").textContent = state.playing ? "stop" : "play";
    begun = performance.now();
    from = state.frame;
    if (state.playing) requestAnimationFrame(tick);
  }

  async function tick(now) {
    if (!state.playing) return;
    const speed = Number(byId("speed").value) * header.framesPerSecond;
    const wanted = (from + Math.floor(((now - begun) / 1000) * speed)) % state.frames;
    if (!busy && wanted !== state.frame) {
      busy = true;
      await setFrame(wanted);
      const next = (wanted + 1) % state.frames; // ahead
      shown.forEach((each, k) => each.frameOf(k ? ofSecond(next) : next).catch(() => {}));
      busy = false;
    }
    requestAnimationFrame(tick);
  }

  byId("about").textContent = `${header.feathers.length} feather${header.feathers.length > 1 ? "s" : ""}` + (header.live ? ", live" : `, ${state.frames} frame${state.frames > 1 ? "s" : ""}`);
  told(header.told);
  if (header.live) {
    document.body.classList.add("live");
    resize();
    await live({ header, state, first, byId, told, draw, paint, showKey, unpacked, pointsOf, speedsBetween, under, rayAt, camera, controls, renderer, mode: () => mode });
  } else await setFrame(0);
  resize();
  look(0, header.points);
  state.ready = !state.problem;
})().catch((error) => {
  document.getElementById("told").textContent = `This page cannot be shown: ${error.message}`;
  window.featherfx = { ...(window.featherfx || {}), ready: false, problem: String(error.message) };
});
