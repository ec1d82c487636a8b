// Decoding: base64, gzip, and packed whole numbers (byte_packing.py says how they are packed).

async function inflated(text) {
  const letters = atob(text.trim());
  const packed = new Uint8Array(letters.length);
  for (let k = 0; k < packed.length; k++) packed[k] = letters.charCodeAt(k);
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Whole numbers (n * columns), row by row.
function unpacked(bytes, entry) {
  const { at, n, columns, width, index } = entry;
  const out = new Int32Array(n * columns);
  for (let column = 0; column < columns; column++) {
    const first = at + column * width * n;
    let last = 0, next = 0;
    for (let k = 0; k < n; k++) {
      let code = 0;
      for (let plane = 0; plane < width; plane++) code |= bytes[first + plane * n + k] << (8 * plane);
      if (index) {
        out[k] = next - code;
        if (code === 0) next++;
      } else {
        last += (code >>> 1) ^ -(code & 1);
        out[k * columns + column] = last;
      }
    }
  }
  return out;
}

// One vertex for each corner of each face: place in metres from the origin, colour, texture coordinates.
function decodedLayer(bytes, entry, step) {
  const index = unpacked(bytes, entry.index), n = index.length;
  const corners = unpacked(bytes, entry.corners);
  const places = new Float32Array(3 * n);
  for (let k = 0; k < n; k++) {
    for (let axis = 0; axis < 3; axis++) places[3 * k + axis] = corners[3 * index[k] + axis] * step;
  }
  let colours = null, uv = null;
  if (entry.colours) {
    const values = unpacked(bytes, entry.colours);
    colours = new Uint8Array(4 * n);
    for (let k = 0; k < n; k++) {
      for (let part = 0; part < 3; part++) colours[4 * k + part] = values[3 * index[k] + part];
    }
  }
  if (entry.uv) {
    const values = unpacked(bytes, entry.uv), { low, scale } = entry.uv;
    uv = new Float32Array(2 * n);
    for (let k = 0; k < 2 * n; k++) {
      const axis = k % 2;
      uv[k] = low[axis] + scale[axis] * values[2 * index[k >> 1] + axis];
    }
  }
  return {
    ...entry, places, colours, uv, outward: outward(places),
    place: entry.place && unpacked(bytes, entry.place),
    channels: entry.channels.map(channel => ({
      ...channel,
      values: unpacked(bytes, channel.values),
      since: channel.since && unpacked(bytes, channel.since),
    })),
    sightings: entry.sightings && decodedSightings(bytes, entry.sightings),
    images: entry.images.map(one => ({
      faces: one.faces,
      data: one.image && bytes.slice(one.image.at, one.image.at + one.image.n),
    })),
  };
}

const FARTHEST = 5; // that a corner is moved, when the edges beside it are moved by 1

// Where each corner is to be moved that the edges beside it move outwards by 1: drawn a fraction of a pixel
// larger, neighbours whose corners do not meet leave no cracks. Bytes, 127 for FARTHEST.
function outward(places) {
  const out = new Int8Array(places.length / 3 * 4);
  for (let corner = 0, at = 0; at < places.length; corner++, at += 3) {
    const first = at - at % 9, one = first + (at - first + 3) % 9, other = first + (at - first + 6) % 9;
    const ux = places[one] - places[at], uy = places[one + 1] - places[at + 1], uz = places[one + 2] - places[at + 2];
    const vx = places[other] - places[at], vy = places[other + 1] - places[at + 1], vz = places[other + 2] - places[at + 2];
    const u = Math.hypot(ux, uy, uz) || 1, v = Math.hypot(vx, vy, vz) || 1;
    const cosine = (ux * vx + uy * vy + uz * vz) / (u * v), sine = Math.sqrt(Math.max(1 - cosine * cosine, 0));
    const scale = -127 / FARTHEST / Math.max(sine, 2 / FARTHEST);
    out[4 * corner] = scale * (ux / u + vx / v);
    out[4 * corner + 1] = scale * (uy / u + vy / v);
    out[4 * corner + 2] = scale * (uz / u + vz / v);
  }
  return out;
}

function decodedSightings(bytes, entry) {
  const counts = unpacked(bytes, entry.counts);
  const start = new Int32Array(counts.length + 1);
  for (let k = 0; k < counts.length; k++) start[k + 1] = start[k] + counts[k];
  return { start, views: unpacked(bytes, entry.views), angles: unpacked(bytes, entry.angles), step: entry.step };
}

// A picture whose lower edge comes first, as texture coordinates run.
function upwards(data) {
  return createImageBitmap(new Blob([data], { type: "image/webp" }), { imageOrientation: "flipY" });
}

// The whole model, with the pictures of its textures.
async function decoded(text) {
  const bytes = await inflated(text);
  const size = new DataView(bytes.buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(bytes.subarray(4, 4 + size)));
  const body = bytes.subarray(4 + size);
  const layers = header.layers.map(entry => decodedLayer(body, entry, header.step));
  for (const layer of layers) {
    for (const one of layer.images) {
      if (one.data) one.bitmap = await upwards(one.data);
    }
  }
  return { ...header, layers, steps: Math.max(header.met.length - 1, 0) };
}
