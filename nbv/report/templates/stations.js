// Stations: what they see, and their names beside them.

// The edges of a station's field of view.
function fieldOf({ at, axes, slope, cone }, radius) {
  const length = 0.16 * radius, [right, down, forward] = axes;
  if (!slope) {
    const ring = Array.from({ length: 33 }, (_, k) => k * Math.PI / 16).map(turn =>
      [at[0] + 0.5 * length * Math.cos(turn), at[1] + 0.5 * length * Math.sin(turn), at[2]]);
    return ring.slice(1).map((end, k) => [ring[k], end]);
  }
  const rim = cone ? Array.from({ length: 24 }, (_, k) => [Math.cos(k * Math.PI / 12), Math.sin(k * Math.PI / 12)])
    : [[-1, -1], [1, -1], [1, 1], [-1, 1]];
  const corners = rim.map(([x, y]) => at.map((place, axis) =>
    place + length * (forward[axis] + x * slope[0] * right[axis] + y * slope[1] * down[axis])));
  const edges = corners.map((corner, k) => [corner, corners[(k + 1) % rim.length]]);
  return [...edges, ...corners.filter((_, k) => k % (rim.length / 4) === 0).map(corner => [at, corner])];
}

// Where a name may stand beside its station, in halves of its size.
const BESIDE = [[1, -1], [-1, -1], [1, 1], [-1, 1], [0, -1.4], [0, 1.4], [2.2, -1], [-2.2, -1], [1, -2.4], [-1, -2.4], [1, 2.4], [-1, 2.4]];

// Names of the stations, those together that lie close to each other; none on another, nor where no place is left.
function placeLabels(box, markers, matrix, canvas, current) {
  const groups = [];
  for (const marker of markers) {
    const seen = projected(matrix, marker.at);
    if (!seen || Math.abs(seen[0]) > 1 || Math.abs(seen[1]) > 1) continue;
    const at = [(seen[0] + 1) / 2 * canvas.clientWidth, (1 - seen[1]) / 2 * canvas.clientHeight];
    const near = groups.find(group => Math.hypot(group.at[0] - at[0], group.at[1] - at[1]) < 16);
    if (near) near.names.push(marker.name);
    else groups.push({ at, names: [marker.name] });
    if (marker === current) (near || groups.at(-1)).current = marker.name;
  }
  const taken = groups.map(({ at }) => [at, [4, 4]]), first = groups.findIndex(group => group.current);
  if (first > 0) groups.unshift(...groups.splice(first, 1));
  box.replaceChildren(...groups.flatMap(({ at, names, current: name }) => {
    const text = name || names.slice(0, 3).join(",") + (names.length > 3 ? ",\u2026" : "");
    const half = [4 + 3.7 * text.length, 9];
    const places = BESIDE.map(([x, y]) => [at[0] + x * (half[0] + 4), at[1] + y * (half[1] + 3)]);
    const free = places.find(place => taken.every(([middle, size]) =>
      [0, 1].some(axis => Math.abs(place[axis] - middle[axis]) >= half[axis] + size[axis])));
    if (!free && !name) return [];
    const middle = free || places[0];
    taken.push([middle, half]);
    const label = make("span", { className: name ? "current" : "" }, text);
    label.style.transform = `translate(${middle[0]}px, ${middle[1]}px) translate(-50%, -50%)`;
    return [label];
  }));
}
