// Sideways: a table that is wider than its place says so, and can be scrolled by keys.

function watchWidth(place) {
  const note = document.createElement("p");
  note.className = "sideways";
  note.textContent = "Scroll sideways for more columns \u2192";
  note.hidden = true;
  place.before(note);
  new ResizeObserver(() => {
    note.hidden = place.scrollWidth <= place.clientWidth + 1;
    if (note.hidden) ["tabindex", "role", "aria-label"].forEach(name => place.removeAttribute(name));
    else Object.entries({ tabindex: 0, role: "region", "aria-label": "Table, scrolls sideways" }).forEach(pair => place.setAttribute(...pair));
  }).observe(place);
}

document.querySelectorAll(".scroll").forEach(watchWidth);
