// Stations: what they see, and their names beside them.

// The edges of a station's field of view.
function fieldOf({ at, axes, slope }, radius) {
  const length = 0.16 * radius, [right, down, forward] = axes;
  if (!slope) {
    const ring = Array.from({ length: 33 }, (_, k) => k * Math.PI / 16).map(turn =>
      [at[0] + 0.5 * length * Math.cos(turn), at[1] + 0.5 * length * Math.sin(turn), at[2]]);
    return ring.slice(1).map((end, k) => [ring[k], end]);
  }
  const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([x, y]) => at.map((place, axis) =>
    place + length * (forward[axis] + x * slope[0] * right[axis] + y * slope[1] * down[axis])));
  return corners.flatMap((corner, k) => [[at, corner], [corner, corners[(k + 1) % 4]]]);
}

// Names of the stations, those together that lie close to each other.
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
  box.replaceChildren(...groups.map(({ at, names, current: name }) => {
    const text = name || names.slice(0, 3).join(",") + (names.length > 3 ? ",\u2026" : "");
    const label = make("span", { className: name ? "current" : "" }, text);
    label.style.transform = `translate(${at[0] + 6}px, ${at[1] - 20}px)`;
    return label;
  }));
}
