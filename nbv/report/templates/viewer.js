// The 3-D view: takes the place of the pictures where the browser can draw it.

const GLIDE_MS = 350, MANY = 8;

class View {
  constructor(figure, model) {
    Object.assign(this, { figure, model, mode: model.mode, step: model.steps, hidden: new Set(), point: null, from: null });
    this.modes = modesOf(model);
    if (!this.modes.some(mode => mode.key === this.mode) && this.modes.length) this.mode = this.modes[0].key;
    this.culls = model.room;
    this.cut = Infinity;
    this.stations = model.markers.filter(marker => marker.step);
    this.current = 0; // number of the view that is looked at, 0 for none
    this.groups = this.groupsOf();
    this.canvas = make("canvas", { tabIndex: 0, role: "application", "aria-label": `${model.label} 3-D view; arrows turn it, Home shows all of it` });
    this.stage = new Stage(this.canvas);
    this.camera = new Camera(model);
    for (const layer of model.layers) this.stage.load(layer);
    this.build();
    watchPointers(this.canvas, this.camera, { changed: () => this.redraw(), pick: (x, y) => this.pick(x, y) });
    this.canvas.addEventListener("keydown", event => this.onKey(event));
    this.canvas.addEventListener("webglcontextlost", () => this.giveUp());
    new ResizeObserver(() => this.resized()).observe(this.canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { this.restroke(); this.redraw(); });
    this.repaint();
    this.restroke();
  }

  // What can be shown and hidden: layers, classes, lines, stations.
  groupsOf() {
    const { model } = this, groups = [], classes = [];
    for (const layer of model.layers) {
      for (const channel of layer.channels.filter(one => one.hides)) {
        channel.categories.forEach((category, k) => {
          const key = `${channel.key} ${k}`;
          if (!classes.some(one => one.key === key)) classes.push({ key, label: category.label, shown: true, chip: category });
        });
      }
      const known = groups.find(one => one.key === layer.key);
      if (layer.label && !known) groups.push({ key: layer.key, label: layer.label, shown: layer.shown, chip: layer.channels.length ? null : layer.paint });
    }
    groups.push(...classes, ...model.lines.map(({ key, label, shown }) => ({ key, label, shown })));
    if (model.markers.length) {
      groups.push({ key: "stations", label: "stations", shown: true });
      groups.push({ key: "fields", label: "fields of view", shown: model.markers.length <= MANY });
    }
    return groups;
  }

  isShown(key) {
    const group = this.groups.find(one => one.key === key);
    return !group || group.shown;
  }

  build() {
    const { model } = this, name = `view-${View.count = (View.count || 0) + 1}`;
    this.labels = make("div", { className: "view-labels", "aria-hidden": "true" });
    this.readout = make("div", { className: "view-readout", hidden: true, role: "status" });
    this.key = make("div");
    this.picture = make("div", { className: "view-stage" }, this.canvas, this.labels, this.key, this.readout);
    const bar = make("div", { className: "view-controls" });
    if (this.modes.length > 1) this.choices = bar.appendChild(choices("Colour by", name, this.modes, this.mode, key => this.setMode(key)));
    if (this.groups.length) bar.append(switches("Show", this.groups, (key, shown) => this.show(key, shown)));
    this.live = make("div", { className: "view-live" }, bar, this.picture, this.buildSteps(), this.buildCut(), help());
    this.figure.prepend(this.live);
    this.figure.classList.add("is-live");
    this.canvas.setAttribute("aria-describedby", `${name}-help`);
    this.live.querySelector(".view-help").id = `${name}-help`;
    this.showKey();
  }

  buildSteps() {
    const row = make("div", { className: "view-row" }), { model } = this, plural = `${capital(model.one)}s`;
    if (!this.stations.length) return row;
    row.append(button("\u25c0", `Last ${model.one} (,)`, () => this.go(-1)), button("\u25b6", `Next ${model.one} (.)`, () => this.go(1)));
    if (model.steps) {
      this.slide = slider(`${plural} so far`, { min: 0, max: model.steps, step: 1, value: this.step }, step => this.setStep(step));
      row.append(this.slide.element);
    }
    row.append(button("Look through", `Stand where the ${model.one} stands (L)`, () => this.lookThrough()));
    row.append(button("All", "Show all of it (Home)", () => this.glide(() => this.camera.home(this.aspect()))));
    this.said = make("span", { className: "view-said", role: "status" });
    row.append(this.said);
    this.say();
    return row;
  }

  buildCut() {
    const [low, high] = [this.model.origin[2], this.model.origin[2] + this.model.size[2]];
    const value = height => height >= high ? "nothing" : `${height.toFixed(2)} m`;
    const span = high - low, first = this.model.cut === null ? 200 : Math.round(200 * this.model.cut / span);
    const set = share => {
      this.cut = share >= 200 ? Infinity : span * share / 200;
      cut.text.textContent = value(low + this.cut);
    };
    const cut = slider("Cut off above", { min: 0, max: 200, step: 1, value: first }, share => {
      set(share);
      this.redraw();
    });
    set(first);
    const backs = switches("Faces that look away", [{ key: "backs", label: "shown", shown: !this.culls }], (_key, shown) => {
      this.culls = !shown;
      this.redraw();
    });
    this.ruler = button("Measure", "Distance between two points (M)", () => { this.measure(); this.canvas.focus({ preventScroll: true }); });
    return make("div", { className: "view-row" }, cut.element, backs, this.ruler);
  }

  showKey() {
    const mode = this.modes.find(one => one.key === this.mode) || { kind: "skin" };
    const paints = this.model.layers.filter(layer => !layer.channels.some(channel => channel.key === this.mode));
    const lines = paints.filter(layer => mode.kind !== "skin" || (layer.marked && mode.key === "marked") || !(layer.images.length || layer.colours)).map(layer => layer.paint);
    const known = mode.kind === "classes" ? mode.categories.map(one => one.label) : [];
    const unlike = lines.filter((one, k) => !known.includes(one.label) && lines.findIndex(other => other.label === one.label) === k);
    const key = keyOf(this.model, mode, unlike);
    this.key.replaceWith(key);
    this.key = key;
  }

  setMode(mode) {
    this.mode = mode;
    for (const input of this.choices ? this.choices.querySelectorAll("input") : []) input.checked = input.value === mode;
    this.repaint();
    this.showKey();
  }

  show(key, shown) {
    this.groups.find(one => one.key === key).shown = shown;
    this.hidden = new Set(this.groups.filter(one => !one.shown).map(one => one.key));
    this.repaint();
    this.restroke();
  }

  setStep(step) {
    this.step = step;
    this.current = step;
    if (this.slide) this.slide.input.value = step;
    this.say();
    this.repaint();
    this.restroke();
    if (this.point) this.read();
  }

  go(by) {
    const last = this.stations.length, from = this.current || (by > 0 ? 0 : last + 1);
    const next = Math.min(Math.max(from + by, 1), last);
    if (this.model.steps) this.setStep(next);
    else { this.current = next; this.say(); this.restroke(); }
    if (this.looking) this.lookThrough();
  }

  say() {
    if (!this.said) return;
    const share = this.model.steps ? ` \u00b7 ${(100 * this.model.met[this.step]).toFixed(1)} % measured` : "";
    const marker = this.stations[this.current - 1], { one } = this.model;
    this.said.textContent = (marker ? `${capital(one)} ${marker.name}` : this.model.steps && !this.step ? `Before the first ${one}` : `${this.stations.length} ${one}${this.stations.length === 1 ? "" : "s"}`) + share;
    if (this.slide) this.slide.text.textContent = `${this.step} of ${this.model.steps}`;
  }

  lookThrough() {
    if (!this.current) this.current = 1;
    const marker = this.stations[this.current - 1];
    this.looking = true;
    this.say();
    this.restroke();
    this.glide(() => this.camera.standAt(marker), true);
  }

  // Move the camera there, at once where less motion is wished for.
  glide(move, keeps = false) {
    this.looking = keeps;
    const { camera } = this, from = camera.state();
    move();
    const to = camera.state();
    from[3] += 2 * Math.PI * Math.round((to[3] - from[3]) / (2 * Math.PI));
    if (matchMedia("(prefers-reduced-motion: reduce)").matches) return this.redraw();
    const begin = performance.now(), tick = now => {
      const share = Math.min(Math.max((now - begin) / GLIDE_MS, 0), 1);
      camera.between(from, to, share * share * (3 - 2 * share));
      this.draw();
      if (share < 1) requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  }

  onKey(event) {
    const mode = /^[1-9]$/.test(event.key) && this.modes[event.key - 1];
    if (moveByKey(event, this.camera, this.aspect())) this.redraw();
    else if (event.ctrlKey || event.altKey || event.metaKey) return;
    else if (mode) this.setMode(mode.key);
    else if (event.key === "," && this.stations.length) this.go(-1);
    else if (event.key === "." && this.stations.length) this.go(1);
    else if (event.key.toLowerCase() === "l" && this.stations.length) this.lookThrough();
    else if (event.key === "Enter") this.pick(0, 0);
    else if (event.key.toLowerCase() === "m") this.measure();
    else if (event.key === "Escape") this.forget();
    else return;
    event.preventDefault();
  }

  pick(x, y) {
    const ray = this.camera.ray(x, y, this.aspect());
    const hit = picked(this.visible(), this.camera.eye(), ray, this.culls, this.cut);
    if (!hit && !this.measuring) return this.forget();
    if (!hit) return;
    if (!this.measuring) this.from = null;
    this.measuring &&= !this.from; // the second point ends it
    if (this.measuring) this.from = hit.point;
    this.point = hit;
    this.read();
    this.restroke();
  }

  // Measure from the point that is read out, or from the next one; once more gives it up.
  measure() {
    this.measuring = !this.measuring;
    this.from = this.measuring && this.point ? this.point.point : null;
    this.showRuler();
    this.restroke();
  }

  showRuler() {
    const ask = this.from ? "Choose the second point" : "Choose the first point";
    const how = `${ask}: click, or Enter for the middle.`, rows = [["Distance", how], ...(this.point ? this.values : [])];
    this.ruler.setAttribute("aria-pressed", Boolean(this.measuring));
    if (this.measuring) showReadout(this.readout, rows, () => { this.forget(); this.canvas.focus(); });
    else if (this.point) this.read();
    else this.readout.hidden = true;
  }

  read() {
    const { layer, face, point } = this.point, { origin } = this.model;
    const place = point.map((value, axis) => (origin[axis] + value).toFixed(3)).join(", ");
    this.values = [["x, y, z", `${place} m`], ...readout(this.model, layer, face, this.step)];
    if (this.from && !this.measuring) this.values.unshift(...distanceRows(this.from, point));
    if (this.measuring) return this.showRuler();
    this.ruler.setAttribute("aria-pressed", false);
    showReadout(this.readout, this.values, () => { this.forget(); this.canvas.focus(); });
  }

  forget() {
    this.point = this.from = null;
    this.measuring = false;
    this.ruler.setAttribute("aria-pressed", false);
    this.readout.hidden = true;
    this.restroke();
  }

  visible() {
    return this.model.layers.filter(layer => this.isShown(layer.key));
  }

  repaint() {
    for (const layer of this.model.layers) this.stage.paint(layer, painted(this.model, layer, this.mode, this.step, this.hidden));
    this.redraw();
  }

  // Lines and dots, in the page's ink where they have no colour of their own.
  restroke() {
    const ink = (getComputedStyle(this.canvas).color.match(/\d+/g) || [0, 0, 0]).slice(0, 3).map(Number), strokes = [];
    for (const lines of this.model.lines.filter(one => this.isShown(one.key))) {
      for (let k = 0; k < lines.ends.length; k += 6) {
        strokes.push([lines.ends.slice(k, k + 3), lines.ends.slice(k + 3, k + 6), lines.colour, 1.2]);
      }
    }
    const now = this.stations[this.current - 1];
    for (const marker of this.model.markers) {
      if (this.isShown("stations")) strokes.push([marker.at, marker.at, marker.colour || ink, marker === now ? 7 : 4.5]);
      if (this.isShown("fields") || (marker === now && this.isShown("stations"))) {
        strokes.push(...fieldOf(marker, this.camera.radius).map(([from, to]) => [from, to, marker.colour || ink, marker === now ? 2 : 1]));
      }
    }
    const end = this.point && this.point.point;
    if (this.from && end) strokes.push([this.from, end, [200, 30, 90], 2.5], [this.from, this.from, [200, 30, 90], 4]);
    if (this.point) strokes.push([this.point.point, this.point.point, [255, 255, 255], 6], [this.point.point, this.point.point, [200, 30, 90], 4]);
    this.stage.setStrokes(strokes);
    this.redraw();
  }

  // Where a point of the world is seen on the canvas, pixels; null behind the eye. For scripts.
  where(...world) {
    const seen = projected(this.camera.matrix(this.aspect()), world.map((value, axis) => value - this.model.origin[axis]));
    return seen && [(seen[0] + 1) / 2 * this.canvas.clientWidth, (1 - seen[1]) / 2 * this.canvas.clientHeight];
  }

  aspect() {
    return Math.max(this.canvas.clientWidth, 1) / Math.max(this.canvas.clientHeight, 1);
  }

  resized() {
    if (!this.placed && this.canvas.clientWidth) {
      this.camera.home(this.aspect());
      this.placed = true;
    }
    this.redraw();
  }

  redraw() {
    this.frame ??= requestAnimationFrame(() => this.draw());
  }

  draw() {
    this.frame = null;
    const matrix = this.stage.draw(this.camera, this.visible(), this.culls, this.cut);
    placeLabels(this.labels, this.isShown("stations") ? this.model.markers : [], matrix, this.canvas, this.stations[this.current - 1]);
  }

  giveUp() {
    this.live.remove();
    this.figure.classList.remove("is-live");
  }
}
