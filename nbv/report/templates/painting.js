// Painting: the colour of every face, by what it is coloured by and how many views there are so far.

const HIDDEN = 0, SKIN = 4, PATTERNS = { plain: 1, hatched: 2, dotted: 3 };
const NOTHING = 65535, NOT_SEEN = { label: "not seen", colour: [230, 158, 26], pattern: "hatched" };

// Colours (red, green, blue, pattern) of a layer's faces.
function painted(model, layer, mode, step, hidden) {
  const faces = new Uint8Array(4 * layer.faces);
  const n = layer.channels.length ? layer.channels[0].values.length : 0;
  const channel = layer.channels.find(one => one.key === mode);
  const sieves = layer.channels.filter(one => one.hides && hidden.size);
  const skin = (mode === "skin" || (mode === "marked" && !layer.marked)) && (layer.colours || layer.images.length);
  const plain = skin ? [255, 255, 255, SKIN] : [...layer.paint.colour, PATTERNS[layer.paint.pattern]];
  if (!n) {
    for (let k = 0; k < faces.length; k++) faces[k] = plain[k % 4];
    return faces;
  }
  const places = new Uint8Array(4 * n);
  for (let place = 0; place < n; place++) {
    const colour = sieves.some(sieve => hidden.has(`${sieve.key} ${classAt(sieve, place, step)}`))
      ? [0, 0, 0, HIDDEN] : channel ? colourAt(model, layer, channel, place, step, plain) : plain;
    places.set(colour, 4 * place);
  }
  const words = new Uint32Array(places.buffer), out = new Uint32Array(faces.buffer), { place } = layer;
  for (let face = 0; face < out.length; face++) out[face] = words[place ? place[face] : face];
  return faces;
}

function colourAt(model, layer, channel, place, step, plain) {
  if (channel.kind === "classes") {
    const category = channel.categories[classAt(channel, place, step)];
    return category ? [...category.colour, PATTERNS[category.pattern]] : plain;
  }
  const value = numberAt(model, layer, channel, place, step);
  if (value === null) return [...NOT_SEEN.colour, PATTERNS[NOT_SEEN.pattern]];
  return [...rampColour(model.ramp, channel, value), PATTERNS.plain];
}

function classAt(channel, place, step) {
  return !channel.since || channel.since[place] <= step ? channel.values[place] : channel.before;
}

// The number at a place, after some of the views where it is known which views see it.
function numberAt(model, layer, channel, place, step) {
  const { sightings } = layer;
  if (step < model.steps && sightings && (channel.key === "quality" || channel.key === "views")) {
    let count = 0, best = Infinity;
    for (let k = sightings.start[place]; k < sightings.start[place + 1] && sightings.views[k] <= step; k++) {
      count++;
      best = Math.min(best, sightings.angles[k] * sightings.step);
    }
    return count === 0 ? null : channel.key === "views" ? count : best;
  }
  const code = channel.values[place];
  return code === 0 ? null : channel.base + channel.scale * code;
}

function rampColour(ramp, channel, value) {
  let share = Math.min(Math.max((value - channel.low) / (channel.high - channel.low), 0), 1);
  if (channel.reversed) share = 1 - share;
  const at = share * (ramp.length - 1), low = Math.min(Math.floor(at), ramp.length - 2), part = at - low;
  return ramp[low].map((value, k) => Math.round(value + part * (ramp[low + 1][k] - value)));
}

// What can be coloured by: natural colours and the channels of all layers, in order.
function modesOf(model) {
  const modes = [];
  if (model.layers.some(layer => layer.images.length || layer.colours)) {
    modes.push({ key: "skin", label: "Colour", kind: "skin" });
    if (model.layers.some(layer => layer.marked)) modes.push({ key: "marked", label: "Colour, inferred marked", kind: "skin" });
  }
  for (const layer of model.layers) {
    for (const channel of layer.channels) {
      if (!modes.some(mode => mode.key === channel.key)) modes.push(channel);
    }
  }
  return modes;
}

// What is read out at a face: pairs of label and text.
function readout(model, layer, face, step) {
  const place = layer.place ? layer.place[face] : face, rows = [];
  for (const channel of layer.channels) {
    if (channel.kind === "classes") {
      const category = channel.categories[classAt(channel, place, step)];
      if (category) rows.push([channel.label, category.label]);
    } else {
      const value = numberAt(model, layer, channel, place, step);
      rows.push([channel.label, value === null ? channel.absent : withUnit(value.toFixed(channel.digits), channel.unit)]);
    }
  }
  rows.push(...Object.entries(layer.facts));
  if (layer.sightings) {
    const { start, views, angles, step: unit } = layer.sightings, seen = [];
    for (let k = start[place]; k < start[place + 1] && views[k] <= step; k++) {
      seen.push(`${views[k]} (${Math.round(angles[k] * unit)}\u00b0)`);
    }
    if (seen.length) rows.push([`Seen by ${model.one}`, seen.slice(0, 12).join(", ") + (seen.length > 12 ? ", ..." : "")]);
  }
  return rows;
}

function withUnit(text, unit) {
  return unit === "\u00b0" || !unit ? text + unit : `${text} ${unit}`;
}
