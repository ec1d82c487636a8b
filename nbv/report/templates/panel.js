// Panel: buttons, sliders and readouts. Names come in as text, never as markup.

function make(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name.includes("-") || name === "role") element.setAttribute(name, value);
    else element[name] = value;
  }
  element.append(...children);
  return element;
}

function css([red, green, blue]) {
  return `rgb(${red}, ${green}, ${blue})`;
}

function capital(word) {
  return word[0].toUpperCase() + word.slice(1);
}

// A group of choices of which one holds.
function choices(title, name, options, chosen, onChoose) {
  const group = make("fieldset", { className: "view-choices" }, make("legend", {}, title));
  options.forEach(({ key, label }, k) => {
    const input = make("input", { type: "radio", name, value: key, checked: key === chosen });
    input.addEventListener("change", () => onChoose(key));
    group.append(make("label", { title: k < 9 ? `Key ${k + 1}` : "" }, input, make("span", {}, label)));
  });
  return group;
}

// A group of things that can be shown or hidden.
function switches(title, options, onSwitch) {
  const group = make("fieldset", { className: "view-switches" }, make("legend", {}, title));
  for (const { key, label, shown, chip } of options) {
    const input = make("input", { type: "checkbox", checked: shown, value: key });
    input.addEventListener("change", () => onSwitch(key, input.checked));
    group.append(make("label", {}, input, ...(chip ? [chipOf(chip)] : []), make("span", {}, label)));
  }
  return group;
}

function chipOf({ colour, pattern }) {
  const chip = make("span", { className: `chip view-${pattern}` });
  chip.style.setProperty("--chip", css(colour));
  return chip;
}

function slider(label, { min, max, step, value }, onSlide) {
  const input = make("input", { type: "range", min, max, step, value, "aria-label": label });
  const text = make("output", {});
  input.addEventListener("input", () => onSlide(Number(input.value)));
  return { element: make("label", { className: "view-slider" }, make("span", {}, label), input, text), input, text };
}

function button(label, title, onPress) {
  const made = make("button", { type: "button", title }, label);
  made.addEventListener("click", onPress);
  return made;
}

// What the colours mean: a bar with numbers, or names.
function keyOf(model, mode, hasPaints) {
  const key = make("div", { className: "view-key" });
  if (mode.kind === "skin") {
    if (hasPaints.length) key.append(make("ul", {}, ...hasPaints.map(keyLine)));
    return key;
  }
  key.append(make("b", {}, mode.unit ? `${mode.label}, ${mode.unit}` : mode.label));
  if (mode.kind === "numbers") {
    key.append(barOf(model.ramp, mode), make("ul", {}, keyLine({ ...NOT_SEEN, label: mode.absent })));
  } else {
    key.append(make("ul", {}, ...mode.categories.map(keyLine)));
  }
  for (const paint of hasPaints) key.querySelector("ul").append(keyLine(paint));
  return key;
}

function keyLine(category) {
  return make("li", {}, chipOf(category), category.label);
}

function barOf(ramp, mode) {
  const stops = (mode.reversed ? [...ramp].reverse() : ramp).map(css).join(", ");
  const bar = make("div", { className: "view-bar" }), numbers = make("div", { className: "view-ticks" });
  bar.style.background = `linear-gradient(to right, ${stops})`;
  const ticks = ticksOf(mode);
  for (const value of ticks) {
    const tick = make("span", {}, `${+value.toFixed(6)}`);
    tick.style.left = `${100 * (value - mode.low) / (mode.high - mode.low)}%`;
    numbers.append(tick);
  }
  if (mode.limit !== null && mode.limit > mode.low && mode.limit < mode.high) {
    const mark = make("i", { title: `required: ${mode.limit} ${mode.unit} or less` });
    mark.style.left = `${100 * (mode.limit - mode.low) / (mode.high - mode.low)}%`;
    bar.append(mark);
  }
  return make("div", { className: "view-scale" }, bar, numbers);
}

// Round numbers from one end of a bar to the other.
function ticksOf({ low, high }) {
  const rough = (high - low) / 4, power = 10 ** Math.floor(Math.log10(rough));
  const apart = power * [1, 1.5, 2, 2.5, 3, 5, 10].find(part => part * power >= rough * 0.999);
  const ticks = [];
  for (let k = Math.ceil(low / apart - 1e-9); k * apart <= high + 1e-9 * apart; k++) ticks.push(k * apart);
  return ticks;
}

// Values at a picked point.
function showReadout(box, rows, onClose) {
  const list = make("dl", {}, ...rows.map(([label, text]) => make("div", {}, make("dt", {}, label), make("dd", {}, text))));
  const close = button("\u00d7", "Close (Escape)", onClose);
  close.setAttribute("aria-label", "Close");
  box.replaceChildren(close, list);
  box.hidden = false;
}

const KEYS = [
  ["arrows", "turn"], ["Shift + arrows", "shift"], ["+ and \u2212", "nearer, farther"], ["Home", "all of it"],
  ["1, 2, ...", "colour by"], [", and .", "view before, next view"], ["L", "look through the view"],
  ["Enter", "read out the middle"], ["M", "measure a distance between two points"], ["Escape", "forget the point"],
];

function help() {
  const rows = KEYS.map(([key, does]) => make("div", {}, make("dt", {}, key), make("dd", {}, does)));
  const mouse = "Drag to turn, drag with the right button or Shift to shift, two fingers on a touch screen; "
    + "the wheel zooms once the picture has been clicked. Click a point to read its values.";
  return make("details", { className: "view-help" }, make("summary", {}, "Mouse and keys"), make("p", {}, mouse), make("dl", {}, ...rows));
}
