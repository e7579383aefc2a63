// What a page shows of a cache or of its body: frames that come by and by, and a mesh that takes them.
"use strict";
// A cache as it is shown: its frames, of which those that were played last stay in memory, and
// its mesh. prefix: of its names at the server. kit: how contents are loaded by name, the material,
// and names of colours that do not change. isBody: whether it is the body of another.
function shownCache(header, prefix, kit, isBody = false) {
  const { load, material } = kit, bases = isBody ? kit.bases.slice(0, 1) : kit.bases;
  const kept = new Map();
  // level: whose points alone come, where a server gives them.
  async function frameOf(number, level = 0) {
    const name = `${prefix}${isBody ? "body" : "frame"}${level || ""}-${number}`, points = own.levels[level].points;
    if (!kept.has(name)) {
      kept.set(name, load(name).then((buffer) => ({ ...unpacked(points, buffer, 0), level })));
      const most = Math.max(8, Math.floor(header.keptBytes / (6 * header.points)));
      while (kept.size > most) kept.delete(kept.keys().next().value);
    }
    const found = kept.get(name);
    kept.delete(name);
    kept.set(name, found);
    try {
      return await found;
    } catch (error) {
      kept.delete(name);
      throw error;
    }
  }
  const mesh = new THREE.Mesh(new THREE.BufferGeometry(), material);
  mesh.frustumCulled = false;
  const own = { header, mesh, frameOf, base: {}, levels: [], level: 0, painted: "", body: null };
  if (header.body) own.body = shownCache({ ...header.body, keptBytes: 0.2 * header.keptBytes }, prefix, kit, true);
  own.refresh = async () => {
    const constant = await load(`${prefix}${isBody ? "body" : ""}constant`);
    let begin = 0;
    const taken = (count) => new Uint32Array(constant, (begin += 4 * count) - 4 * count, count);
    own.levels = [[header.points, header.triangles], ...header.levels].map(([points, triangles], k) =>
      levelOf(k ? taken(points) : null, points, taken(3 * triangles)));
    bases.forEach((name, k) => {
      own.base[name] = new Uint8Array(constant, begin + 3 * k * header.points, 3 * header.points);
    });
    kept.clear();
    own.whole = { box: new Float32Array(6), places: new Uint16Array(3 * header.points) };
    own.draws(0);
    await own.body?.refresh();
  };
  // Points and triangles of which later levels have fewer.
  own.draws = (level) => {
    own.level = Math.min(level, own.levels.length - 1);
    mesh.geometry = own.levels[own.level].geometry;
    own.painted = "";
  };
  // A value of a frame, which comes when a colour asks for it.
  own.value = async (found, name, number) => {
    found.values[name] = found.values[name] || new Uint8Array(await load(`${prefix}${name}-${number}`));
  };
  // Places in the box of a frame are drawn as they are; the mesh has its size.
  own.put = (found) => {
    const { chosen, points, position } = own.levels[own.level], to = position.array, from = found.places;
    const every = !chosen || found.level > 0;
    for (let k = 0; k < points; k++) {
      const at = 3 * (every ? k : chosen[k]);
      to[4 * k] = from[at];
      to[4 * k + 1] = from[at + 1];
      to[4 * k + 2] = from[at + 2];
    }
    if (!found.level) own.whole = found;
    position.needsUpdate = true;
    mesh.position.fromArray(found.box);
    mesh.scale.fromArray(found.box, 3);
    mesh.updateMatrixWorld();
    mesh.geometry.boundingSphere = null;
  };
  // Where a point is, in the frame that was there in full last.
  own.point = (k, to) => {
    const { box, places } = own.whole, at = (c) => box[c] + (box[3 + c] / 65535) * places[3 * k + c];
    return to.set(at(0), at(1), at(2));
  };
  // Which point of the cache a corner of what is drawn is.
  own.pointOf = (corner) => own.levels[own.level].chosen?.[corner] ?? corner;
  return own;
}

// Points of a cache, all or those that are chosen. Four numbers a point, of which three count:
// what is not aligned to four bytes is converted anew by drivers, for every frame.
function levelOf(chosen, points, corners) {
  const geometry = new THREE.BufferGeometry();
  const position = new THREE.BufferAttribute(new Uint16Array(4 * points), 4, true);
  const colour = new THREE.BufferAttribute(new Uint8Array(4 * points).fill(255), 4, true);
  position.usage = colour.usage = 35048; // changes often
  geometry.setAttribute("position", position);
  geometry.setAttribute("color", colour);
  geometry.setIndex(new THREE.BufferAttribute(corners, 1));
  return { chosen, points, triangles: corners.length / 3, geometry, position, colour };
}

// A frame that begins somewhere in a buffer, and room for values by name.
function unpacked(points, buffer, begin) {
  const box = new Float32Array(buffer, begin, 6), places = new Uint16Array(buffer, begin + 24, 3 * points);
  return { box, places, values: {}, level: 0 };
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
