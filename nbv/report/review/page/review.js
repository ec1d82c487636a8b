// Review: asks the server what is known and what follows, and shows it before it is taken.

const $ = id => document.getElementById(id), EVERY_MS = 3000;
const RELATIONS = ["parallel", "perpendicular", "coplanar", "distance", "angle", "equal_radius", "coaxial", "vertical", "horizontal", "regular", "symmetric"];
const VALUED = { distance: "m", angle: "deg" };
const state = { version: -1, chosen: [], place: null, wait: null, trial: null };

// The view whose clicks are questions; another one may lie over it and look the same way.
class ReviewView extends View {
  pick(x, y) {
    super.pick(x, y);
    if (this.point && this.onPick) this.onPick(this.point.point.map((value, axis) => value + this.model.origin[axis]));
  }

  draw() {
    super.draw();
    if (this.onDraw) this.onDraw();
  }

  setMode(mode) {
    super.setMode(mode);
    if (this.over) this.over.setMode(mode);
  }

  show(key, shown) {
    super.show(key, shown);
    if (this.over && this.over.groups.some(one => one.key === key)) this.over.show(key, shown);
  }
}

async function ask(question, body) {
  const how = body === undefined ? {} : { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) };
  const answer = await fetch(question, how);
  if (question === "view" || question === "trial-view") return answer.text();
  const held = await answer.json();
  if (!answer.ok) throw new Error(held.error);
  return held;
}

// Do one thing at a time, and say what went wrong.
async function doing(work) {
  if (state.busy) return;
  state.busy = true;
  document.body.classList.add("is-busy");
  tell("");
  try {
    await work();
  } catch (error) {
    tell(error.message);
  } finally {
    state.busy = false;
    document.body.classList.remove("is-busy");
  }
}

function tell(text) {
  $("told").textContent = text;
  $("told").hidden = !text;
}

const m2 = value => `${value.toFixed(2)} m\u00b2`;

async function show(held) {
  state.version = held.version;
  $("totals").textContent = `${m2(held.measured_m2)} measured, ${m2(held.inferred_m2)} inferred, ${held.surfaces.length} surfaces`;
  $("undo").disabled = !held.said.length;
  $("redo").disabled = !held.undone;
  $("surfaces").replaceChildren(tableOf(["", "kind", "measured", "inferred"], held.surfaces.map(one => [
    button(String(one.number), "What is known of it", () => askSurface(one.number)), one.kind + (one.edits.length ? ` (${one.edits.join(", ")})` : ""), m2(one.measured_m2), m2(one.inferred_m2),
  ])));
  $("relations").replaceChildren(held.relations.length
    ? tableOf(["", "of", "", "p"], held.relations.map(one => [one.kind + (one.given ? " (stated)" : ""), one.surfaces.join(" "), one.status, one.p === null ? "" : one.p.toPrecision(2)]))
    : make("p", { className: "note" }, "None."));
  $("warnings").replaceChildren(...held.warnings.map(text => make("li", {}, text)));
  $("history").replaceChildren(...held.said.map(one => make("li", {}, sentence(one))));
  await drawView();
}

function sentence(one) {
  return one.do ? `${one.do}${one.note ? `: ${one.note}` : ""}` : `${one.forbidden ? "not " : ""}${one.type.replace("_", " ")}${one.value === undefined ? "" : ` ${one.value}`}${one.note ? `: ${one.note}` : ""}`;
}

function tableOf(heads, rows) {
  return make("table", {}, make("thead", {}, make("tr", {}, ...heads.map(text => make("th", {}, text)))),
    make("tbody", {}, ...rows.map(row => make("tr", {}, ...row.map(cell => make("td", {}, cell))))));
}

async function drawView() {
  const model = await decoded(await ask("view")), before = state.view && state.view.camera.state(), origin = state.view && state.view.model.origin;
  const mode = state.view && state.view.mode;
  dropAfter();
  const figure = $("view");
  figure.replaceChildren();
  state.view = figure.view = new ReviewView(figure, model);
  state.view.onPick = place => clicked(place);
  if (before) {
    lookAlike(state.view, before, origin);
    state.view.placed = true;
    state.view.setMode(mode);
  }
}

// Look from where another view looked, whose coordinates begin elsewhere.
function lookAlike(view, camera, origin) {
  const moved = camera.map((value, k) => (k < 3 ? value + origin[k] - view.model.origin[k] : value));
  view.camera.between(moved, moved, 0);
  view.redraw();
}

function dropAfter() {
  if (!state.after) return;
  state.after.canvas.remove();
  state.divide.remove();
  state.view.over = state.view.onDraw = null;
  state.after = null;
  $("compare").hidden = true;
}

async function drawAfter() {
  dropAfter();
  const { view } = state, after = new ReviewView(make("figure"), await decoded(await ask("trial-view")));
  after.canvas.className = "after";
  after.canvas.tabIndex = -1;
  after.placed = true;
  state.divide = make("div", { className: "divide" });
  view.picture.insertBefore(state.divide, view.labels);
  view.picture.insertBefore(after.canvas, state.divide);
  view.over = state.after = after;
  after.setMode(view.mode);
  view.onDraw = () => lookAlike(after, view.camera.state(), view.model.origin);
  view.redraw();
  $("compare").hidden = false;
  slide();
}

function slide() {
  if (!state.after) return;
  const share = $("slide").value;
  state.after.canvas.style.clipPath = `inset(0 0 0 ${share}%)`;
  state.divide.style.left = `${share}%`;
}

function clicked(place) {
  if (state.wait) {
    const { then } = state.wait;
    state.wait = null;
    return then(place);
  }
  return doing(async () => showFacts(await ask("ask", { place }), place));
}

function askSurface(number) {
  return doing(async () => showFacts(await ask("ask", { surface: number }), null));
}

// Wait for another click.
function next(text, then) {
  tell(text);
  state.wait = { then };
}

function rowsOf(pairs) {
  return make("dl", {}, ...pairs.filter(([, text]) => text).flatMap(([name, text]) => [make("dt", {}, name), make("dd", {}, text)]));
}

function showFacts(facts, place) {
  if (facts.surface === null) {
    $("place").replaceChildren(make("p", { className: "note" }, "No surface is here: what was measured here belongs to none."), measureButton(place));
    return;
  }
  const number = facts.surface, spot = facts.place, anchor = facts.anchor;
  const hides = facts.hidden_by.map(one => `${one.surface ? `surface ${one.surface}` : "what belongs to no surface"} ${Math.round(100 * one.share)} %`);
  const ends = facts.ends.map(one => `${one.length_m.toFixed(2)} m: ${one.why} (${one.known})`);
  const rows = [
    ["here", spot && `${spot.state}${spot.state === "inferred" ? `, ${spot.provenance}, probability ${spot.probability.toFixed(2)}` : ""}${spot.sd_mm === null ? "" : `, \u00b1${(1.96 * spot.sd_mm).toFixed(1)} mm`}`],
    ["area", `${m2(facts.measured_m2)} measured, ${m2(facts.inferred_m2)} inferred, ${m2(facts.unknown_m2)} unknown`],
    ["ends", ends.join("; ")], ["hidden by", hides.join(", ")],
    ["seen by", facts.seen_by.map(one => `${one.scan} (${one.pixels} pixels)`).join(", ")],
    ["relations", facts.relations.join(", ")], ["you said", facts.edits.join(", ")], ["openings", facts.openings ? String(facts.openings) : ""],
  ];
  const say = (what, more = {}) => ({ do: what, surface: anchor, note: `surface ${number}`, ...more });
  const acts = [
    button("Reject what is inferred", "Keep it as it was measured", () => trial(say("reject"))),
    button("Accept what is hidden", "Fill it up to its known ends", () => trial(say("accept"))),
    button("Add to relation", "Choose it for a relation", () => choose(number, anchor)),
    button("Merge with the chosen one", "They are one surface", () => merge(number, anchor)),
    button("Opening", "Click two opposite corners", () => opening(number, say)),
    button("Where to stand for what is hidden", "Plan the next station for it", () => stand(number)),
  ];
  if (place) acts.push(button("End or split here", "Choose a line or plane near here", () => snaps(number, place, say)), measureButton(place));
  $("place").replaceChildren(make("h2", {}, `Surface ${number}, ${facts.kind}`), rowsOf(rows), make("div", { className: "review-row" }, ...acts));
}

function measureButton(place) {
  return button("Measure from here", "Click the other end", () => next("Click the other end.", other => doing(async () => {
    const found = await ask("measure", { places: [place, other] });
    tell(`${found.length_m.toFixed(4)} m${found.half_m === null ? "; how exact it is is not known: an end lies on no surface" : ` \u00b1 ${found.half_m.toFixed(4)} m (95 %)`}`);
  })));
}

function opening(number, say) {
  next("Click one corner of the opening.", one => next("Click the opposite corner.", two => doing(async () => {
    const outline = await ask("rectangle", { surface: number, places: [one, two] });
    await tryOut(say("opening", { outline }));
  })));
}

function snaps(number, place, say) {
  return doing(async () => {
    const found = await ask("snaps", { surface: number, place }), row = make("div", { className: "review-row" });
    for (const { sentence: text, cut } of found) {
      row.append(button(`End ${text}`, "", () => trial(say("end", cut))), button(`Split ${text}`, "", () => trial(say("split", cut))));
    }
    $("place").append(make("h2", {}, "Where"), row);
  });
}

function stand(number) {
  return doing(async () => {
    tell("Planning where to stand; this may take a while.");
    const found = await ask("stand", { surface: number });
    tell(found.why_none ? `Nowhere: ${found.why_none}.` : `Stand at ${found.place.map(value => value.toFixed(2)).join(", ")} m (z up), look along ${found.direction.map(value => value.toFixed(2)).join(", ")}: about ${m2(found.gain_m2)} more.`);
    if (!found.why_none) mark(found);
  });
}

// The station as a line from its place along its view.
function mark({ place, direction }) {
  const { view } = state, at = place.map((value, axis) => value - view.model.origin[axis]);
  view.model.lines = view.model.lines.filter(one => one.key !== "next");
  view.model.lines.push({ key: "next", label: "next station", ends: [...at, ...at.map((value, axis) => value + direction[axis])], colour: [200, 30, 90], shown: true });
  view.restroke();
}

function choose(number, anchor) {
  state.chosen.push({ number, anchor });
  $("chosen").textContent = `Surfaces ${state.chosen.map(one => one.number).join(", ")}`;
}

function merge(number, anchor) {
  const others = state.chosen.filter(one => one.number !== number);
  if (!others.length) return tell('Choose the other surface first, with "Add to relation".');
  return trial({ do: "merge", surfaces: [...others.map(one => one.anchor), anchor], note: `surfaces ${[...others.map(one => one.number), number].join(", ")}` });
}

function relation() {
  const type = $("kind").value, said = { type, surfaces: state.chosen.map(one => one.anchor), note: `surfaces ${state.chosen.map(one => one.number).join(", ")}` };
  if (VALUED[type]) said.value = Number($("value").value);
  return said;
}

function trial(statement) {
  return doing(() => tryOut(statement));
}

async function tryOut(statement) {
  const found = await ask("try", { statement }), card = $("consequence");
  const change = ([before, after]) => `${m2(before)} \u2192 ${m2(after)}`;
  const moved = one => (one.moved_mm >= 0.05 ? `, moved ${one.moved_mm.toFixed(1)} mm (${one.moved_sd.toFixed(1)} sd)` : "");
  const named = one => (one.before === null ? `new ${one.kind}, surface ${one.after} then` : one.after === null ? `surface ${one.before} goes` : `surface ${one.before}`);
  card.className = `card ${found.is_refused ? "refused" : "holds"}`;
  card.replaceChildren(
    make("h2", {}, `${capital(sentence(statement))}: what follows`), ...found.sentences.map(text => make("p", {}, text)),
    rowsOf([["measured", change(found.measured_m2)], ["inferred", change(found.inferred_m2)], ["unknown", change(found.unknown_m2)]]),
    make("ul", {}, ...found.surfaces.map(one => make("li", {}, `${named(one)}: inferred ${change(one.inferred_m2)}${moved(one)}`))),
    make("p", { className: "note" }, `${found.seconds.toFixed(1)} s`),
    make("div", { className: "review-row" }, button("Take it", "It holds from now on (t)", () => take(statement)), button("Discard", "Forget it (d)", discard)),
  );
  card.querySelector("button").className = "strong";
  card.hidden = false;
  state.trial = statement;
  await drawAfter();
}

function take(statement) {
  return doing(async () => {
    const held = await ask("take", { statement });
    discard();
    state.chosen = [];
    $("chosen").textContent = "None is chosen.";
    $("place").replaceChildren(make("p", { className: "note" }, "Taken."));
    await show(held);
  });
}

function discard() {
  state.trial = null;
  $("consequence").hidden = true;
  dropAfter();
}

function step(question) {
  return doing(async () => {
    const held = await ask(question, {});
    discard();
    await show(held);
  });
}

function save() {
  return doing(async () => {
    tell("Writing all outputs; this takes as long as the completion did.");
    const { written } = await ask("save", {});
    tell(`Written: ${written.join(", ")}`);
  });
}

RELATIONS.forEach(kind => $("kind").append(make("option", { value: kind }, kind.replace("_", " "))));
$("kind").addEventListener("change", () => { $("value").hidden = !VALUED[$("kind").value]; });
$("test").addEventListener("click", () => trial(relation()));
$("clear").addEventListener("click", () => { state.chosen = []; $("chosen").textContent = "None is chosen."; });
$("slide").addEventListener("input", slide);
$("undo").addEventListener("click", () => step("undo"));
$("redo").addEventListener("click", () => step("redo"));
$("save").addEventListener("click", save);
document.addEventListener("keydown", event => {
  if (event.ctrlKey || event.altKey || event.metaKey || /INPUT|SELECT/.test(event.target.tagName)) return;
  const does = { u: () => $("undo").click(), r: () => $("redo").click(), s: save, t: () => state.trial && take(state.trial), d: discard }[event.key];
  if (does) does();
});
setInterval(async () => {
  if (state.busy) return;
  try {
    const held = await ask("state");
    if (held.version !== state.version && !state.busy) doing(() => show(held)); // the other page said something
    document.body.classList.remove("is-away");
  } catch {
    tell("The server does not answer. What was taken is kept: start `unseen review` again.");
  }
}, EVERY_MS);
doing(async () => show(await ask("state")));
