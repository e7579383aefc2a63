// Draws meshes of a scene by the processor, for browsers without a graphics card, whose own software
// renderers take ten times as long. It has as much of THREE.WebGLRenderer as the page asks for. Faces
// are lit flat from both sides as MeshLambertMaterial does, by a sky and a sun of the camera.
function softwareRenderer() {
  const canvas = document.createElement("canvas");
  const paper = canvas.getContext("2d", { alpha: false, willReadFrequently: true });
  let ratio = 1, size = [1, 1], view = [0, 0, 1, 1];
  let image = null, pixels = null, nearness = null; // of the view; nearness: 1 / depth
  let corners = new Float32Array(0); // x, y in pixels and nearness, 0 behind the camera
  const display = new Uint8Array(4096).map((_, k) => {
    const c = k / 4095;
    return Math.round(255 * (c <= 0.0031308 ? 12.92 * c : 1.055 * c ** (1 / 2.4) - 0.055));
  });
  const packed = (r, g, b) => ((255 << 24) | (b << 16) | (g << 8) | r) >>> 0;
  const shown = (c) => display[Math.min(4095, (4095 * c) | 0)];

  function resized() {
    const [wide, high] = size.map((each) => Math.max(1, Math.floor(ratio * each)));
    if (canvas.width !== wide || canvas.height !== high) Object.assign(canvas, { width: wide, height: high });
    view = [0, 0, ...size];
  }

  function render(scene, camera) {
    const [left, , ...own] = view.map((each) => Math.floor(ratio * each)), [wide, high] = own.map((each) => Math.max(1, each));
    if (image?.width !== wide || image.height !== high) {
      image = new ImageData(wide, high);
      pixels = new Uint32Array(image.data.buffer);
      nearness = new Float32Array(wide * high);
    }
    scene.updateMatrixWorld();
    if (!camera.parent) camera.updateMatrixWorld();
    const { r, g, b } = scene.background;
    pixels.fill(packed(shown(r), shown(g), shown(b)));
    nearness.fill(0);
    for (const each of scene.children) if (each.isMesh && each.visible) fill(each, camera, lightsOf(scene, camera), wide, high);
    paper.putImageData(image, left, 0);
  }

  // Directions in the world, and colours by their intensity, as a matt face sends them back.
  function lightsOf(scene, camera) {
    const bright = (light, colour) => colour.toArray().map((each) => (each * light.intensity) / Math.PI);
    const sky = scene.children.find((each) => each.isHemisphereLight), sun = camera.children.find((each) => each.isDirectionalLight);
    return {
      up: sky.position.clone().normalize().toArray(), above: bright(sky, sky.color), below: bright(sky, sky.groundColor),
      to: sun.position.clone().normalize().transformDirection(camera.matrixWorld).toArray(), sun: bright(sun, sun.color),
    };
  }

  function fill(mesh, camera, lights, wide, high) {
    const { position, color, index } = Object.assign({ index: mesh.geometry.index }, mesh.geometry.attributes);
    const places = position.array, tints = color.array, faces = index.array, points = position.count;
    const e = camera.projectionMatrix.clone().multiply(camera.matrixWorldInverse).multiply(mesh.matrixWorld).elements;
    const unit = 1 / 65535, halfX = 0.5 * wide, halfY = 0.5 * high;
    if (corners.length < 3 * points) corners = new Float32Array(3 * points);
    for (let k = 0, at = 0, to = 0; k < points; k++, at += 4, to += 3) {
      const x = places[at] * unit, y = places[at + 1] * unit, z = places[at + 2] * unit;
      const w = e[3] * x + e[7] * y + e[11] * z + e[15];
      if (w <= camera.near) {
        corners[to + 2] = 0;
        continue;
      }
      const near = 1 / w;
      corners[to] = halfX + halfX * near * (e[0] * x + e[4] * y + e[8] * z + e[12]);
      corners[to + 1] = halfY - halfY * near * (e[1] * x + e[5] * y + e[9] * z + e[13]);
      corners[to + 2] = near;
    }
    const m = mesh.matrixWorld.elements, [scaleX, scaleY, scaleZ] = [m[0] * unit, m[5] * unit, m[10] * unit];
    const [fromX, fromY, fromZ] = [12, 13, 14].map((k) => camera.matrixWorld.elements[k] - m[k]);
    for (let k = 0; k < faces.length; k += 3) {
      const a = faces[k], b = faces[k + 1], c = faces[k + 2];
      const na = corners[3 * a + 2], nb = corners[3 * b + 2], nc = corners[3 * c + 2];
      if (na === 0 || nb === 0 || nc === 0) continue;
      const ax = corners[3 * a], ay = corners[3 * a + 1], bx = corners[3 * b], by = corners[3 * b + 1], cx = corners[3 * c], cy = corners[3 * c + 1];
      // pixels whose middles are in the box around it
      const low = Math.max(0, Math.ceil(Math.min(ax, bx, cx) - 0.5)), end = Math.min(wide - 1, Math.floor(Math.max(ax, bx, cx) - 0.5));
      if (low > end) continue;
      const top = Math.max(0, Math.ceil(Math.min(ay, by, cy) - 0.5)), foot = Math.min(high - 1, Math.floor(Math.max(ay, by, cy) - 0.5));
      if (top > foot) continue;
      const area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay);
      if (area === 0) continue;
      // light of the face, as it is seen
      const pa = 4 * a, pb = 4 * b, pc = 4 * c;
      const ux = (places[pb] - places[pa]) * scaleX, uy = (places[pb + 1] - places[pa + 1]) * scaleY, uz = (places[pb + 2] - places[pa + 2]) * scaleZ;
      const vx = (places[pc] - places[pa]) * scaleX, vy = (places[pc + 1] - places[pa + 1]) * scaleY, vz = (places[pc + 2] - places[pa + 2]) * scaleZ;
      let nx = uy * vz - uz * vy, ny = uz * vx - ux * vz, nz = ux * vy - uy * vx;
      const facing = nx * (fromX - places[pa] * scaleX) + ny * (fromY - places[pa + 1] * scaleY) + nz * (fromZ - places[pa + 2] * scaleZ);
      const length = (facing < 0 ? -1 : 1) / (Math.sqrt(nx * nx + ny * ny + nz * nz) || 1);
      nx *= length; ny *= length; nz *= length;
      const lit = Math.max(0, nx * lights.to[0] + ny * lights.to[1] + nz * lights.to[2]);
      const upper = 0.5 + 0.5 * (nx * lights.up[0] + ny * lights.up[1] + nz * lights.up[2]);
      const red = (lit * lights.sun[0] + lights.below[0] + upper * (lights.above[0] - lights.below[0])) / 255;
      const green = (lit * lights.sun[1] + lights.below[1] + upper * (lights.above[1] - lights.below[1])) / 255;
      const blue = (lit * lights.sun[2] + lights.below[2] + upper * (lights.above[2] - lights.below[2])) / 255;
      const ar = shown(tints[pa] * red), ag = shown(tints[pa + 1] * green), ab = shown(tints[pa + 2] * blue);
      const br = shown(tints[pb] * red) - ar, bg = shown(tints[pb + 1] * green) - ag, bb = shown(tints[pb + 2] * blue) - ab;
      const cr = shown(tints[pc] * red) - ar, cg = shown(tints[pc + 1] * green) - ag, cb = shown(tints[pc + 2] * blue) - ab;
      // shares of b and c, by pixel
      const inverse = 1 / area, bAlong = (cy - ay) * inverse, bDown = -(cx - ax) * inverse, cAlong = -(by - ay) * inverse, cDown = (bx - ax) * inverse;
      for (let y = top; y <= foot; y++) {
        const px = low + 0.5 - ax, py = y + 0.5 - ay;
        let ofB = px * bAlong + py * bDown, ofC = px * cAlong + py * cDown;
        for (let at = y * wide + low, last = y * wide + end; at <= last; at++, ofB += bAlong, ofC += cAlong) {
          if (ofB < 0 || ofC < 0 || ofB + ofC > 1) continue;
          const near = na + ofB * (nb - na) + ofC * (nc - na);
          if (near <= nearness[at]) continue;
          nearness[at] = near;
          pixels[at] = (255 << 24) | ((ab + ofB * bb + ofC * cb) << 16) | ((ag + ofB * bg + ofC * cg) << 8) | (ar + ofB * br + ofC * cr);
        }
      }
    }
  }

  return {
    domElement: canvas, render,
    setPixelRatio: (value) => { ratio = value; resized(); },
    setSize: (wide, high) => {
      size = [wide, high];
      Object.assign(canvas.style, { width: `${wide}px`, height: `${high}px` });
      resized();
    },
    setViewport: (...values) => { view = values; },
    setScissorTest() {}, setScissor() {},
  };
}
