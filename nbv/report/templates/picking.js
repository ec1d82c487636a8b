// Picking: the first face that a ray meets, among those that are drawn (Moeller and Trumbore 1997).

function picked(layers, origin, ray, culls, cut) {
  let best = null;
  for (const layer of layers) {
    const hit = firstFace(layer, origin, ray, culls, cut, best ? best.range : Infinity);
    if (hit) best = { ...hit, layer };
  }
  return best && { ...best, point: origin.map((place, axis) => place + best.range * ray[axis]) };
}

// How far two points are apart, metres, as rows of a readout.
function distanceRows(from, to) {
  const apart = to.map((place, axis) => place - from[axis]), length = Math.hypot(...apart);
  const [unit, scale, digits] = length < 1 ? ["mm", 1000, 1] : ["m", 1, 3];
  const text = parts => `${parts.map(part => (scale * part).toFixed(digits)).join(", ")} ${unit}`;
  return [["Distance", text([length])], ["of it along x, y, z", text(apart)]];
}

function firstFace({ places, paint4: paint }, [ox, oy, oz], [dx, dy, dz], culls, cut, farthest) {
  let found = -1, range = farthest;
  for (let face = 0, at = 0; at < places.length; face++, at += 9) {
    if (paint[4 * face + 3] === HIDDEN) continue;
    const ax = places[at], ay = places[at + 1], az = places[at + 2];
    const ux = places[at + 3] - ax, uy = places[at + 4] - ay, uz = places[at + 5] - az;
    const vx = places[at + 6] - ax, vy = places[at + 7] - ay, vz = places[at + 8] - az;
    const px = dy * vz - dz * vy, py = dz * vx - dx * vz, pz = dx * vy - dy * vx;
    const volume = ux * px + uy * py + uz * pz;
    if (culls ? volume <= 0 : volume === 0) continue;
    const tx = ox - ax, ty = oy - ay, tz = oz - az, one = (tx * px + ty * py + tz * pz) / volume;
    if (one < 0 || one > 1) continue;
    const qx = ty * uz - tz * uy, qy = tz * ux - tx * uz, qz = tx * uy - ty * ux;
    const two = (dx * qx + dy * qy + dz * qz) / volume;
    if (two < 0 || one + two > 1) continue;
    const away = (vx * qx + vy * qy + vz * qz) / volume;
    if (away > 0 && away < range && oz + away * dz <= cut) {
      range = away;
      found = face;
    }
  }
  return found < 0 ? null : { face: found, range };
}
