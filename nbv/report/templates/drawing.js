// Drawing: faces by one WebGL 2 program, lines and dots by another; only when something has changed.

const WIDER = 0.2; // pixels by which a face's edges are moved outwards
const ROW = 2048; // faces in a row of the texture that holds their colours

const FACE_VERTEX = `#version 300 es
uniform mat4 view; uniform sampler2D paint; uniform vec3 eye; uniform float wider;
layout(location = 0) in vec3 place; layout(location = 1) in vec4 colour; layout(location = 2) in vec2 uv;
layout(location = 3) in vec4 outward;
flat out vec4 look; out vec3 at; out vec3 tint; out vec2 texel;
void main() {
  int face = gl_VertexID / 3;
  look = texelFetch(paint, ivec2(face % ${ROW}, face / ${ROW}), 0);
  at = place; tint = colour.rgb; texel = uv;
  gl_Position = look.a == 0.0 ? vec4(2.0, 2.0, 2.0, 1.0)
    : view * vec4(place + wider * distance(eye, place) * outward.xyz, 1.0);
}`;

// Shades as drawing.py does; patterns as picture.py has them.
const FACE_FRAGMENT = `#version 300 es
precision highp float;
uniform sampler2D image; uniform vec3 eye; uniform float cut, pixel;
flat in vec4 look; in vec3 at; in vec3 tint; in vec2 texel; out vec4 result;
const vec3 light = vec3(0.2506, -0.3508, 0.9022);
float soft(float wave) { return 1.0 / (1.0 + exp(-6.0 * wave)); }
void main() {
  vec3 normal = normalize(cross(dFdx(at), dFdy(at))), way = normalize(eye - at);
  vec3 base = texture(image, texel).rgb;
  if (at.z > cut) discard;
  normal *= sign(dot(normal, way));
  float shade = 0.66 + 0.16 * dot(normal, way) + 0.2 * (0.5 + 0.5 * dot(normal, light));
  int pattern = int(round(255.0 * look.a));
  vec2 spot = gl_FragCoord.xy / pixel * 6.2832;
  if (pattern == 4) { result = vec4(min(tint * base * shade, 1.0), 1.0); return; }
  vec3 colour = min(1.15 * look.rgb * shade, 1.0);
  if (pattern == 2) {
    float wave = sin((spot.x - spot.y) / 9.0);
    colour = mix(vec3(1.0), look.rgb, 0.28 + 0.72 * soft(wave - 0.1)) * (0.2 + 0.85 * shade);
  }
  if (pattern == 3) colour = mix(colour, vec3(0.53, 0.54, 0.54) * shade, soft(cos(spot.x / 8.0) + cos(spot.y / 8.0) - 0.9));
  result = vec4(colour, 1.0);
}`;

const STROKE_VERTEX = `#version 300 es
uniform mat4 view; uniform vec2 size;
layout(location = 0) in vec3 from; layout(location = 1) in vec3 to; layout(location = 2) in vec4 pen;
out vec3 colour; out vec2 corner; flat out float isDot;
void main() {
  vec4 p = view * vec4(from, 1.0), q = view * vec4(to, 1.0);
  float near = 1e-3 * max(abs(p.w), abs(q.w)) + 1e-6;
  if (p.w < near && q.w > near) p = mix(p, q, (near - p.w) / (q.w - p.w));
  if (q.w < near && p.w > near) q = mix(q, p, (near - q.w) / (p.w - q.w));
  vec2 way = (q.xy / q.w - p.xy / p.w) * size;
  isDot = from == to ? 1.0 : 0.0;
  way = dot(way, way) > 1e-8 ? normalize(way) : vec2(1.0, 0.0);
  corner = vec2(float(gl_VertexID & 1), float(gl_VertexID >> 1)) * 2.0 - 1.0;
  vec4 end = corner.x < 0.0 ? p : q;
  vec2 off = (way * corner.x + vec2(-way.y, way.x) * corner.y) * pen.a * 63.75 / size;
  colour = pen.rgb;
  gl_Position = end.w < near ? vec4(2.0, 2.0, 2.0, 1.0) : vec4(end.xy + off * end.w, end.z - 2e-4 * end.w, end.w);
}`;

const STROKE_FRAGMENT = `#version 300 es
precision highp float;
in vec3 colour; in vec2 corner; flat in float isDot; out vec4 result;
void main() {
  if (isDot > 0.5 && dot(corner, corner) > 1.0) discard;
  result = vec4(colour, 1.0);
}`;

class Stage {
  constructor(canvas) {
    const gl = canvas.getContext("webgl2", { antialias: true, alpha: true, powerPreference: "low-power" });
    if (!gl) throw new Error("no WebGL 2");
    Object.assign(this, { canvas, gl, draws: 0 });
    this.faces = program(gl, FACE_VERTEX, FACE_FRAGMENT);
    this.strokes = program(gl, STROKE_VERTEX, STROKE_FRAGMENT);
    this.white = texture(gl, gl.NEAREST, gl.REPEAT);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array([255, 255, 255, 255]));
    this.lines = { vao: gl.createVertexArray(), buffer: gl.createBuffer(), n: 0 };
    gl.bindVertexArray(this.lines.vao);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.lines.buffer);
    for (const [slot, size, type, at] of [[0, 3, gl.FLOAT, 0], [1, 3, gl.FLOAT, 12], [2, 4, gl.UNSIGNED_BYTE, 24]]) {
      gl.enableVertexAttribArray(slot);
      gl.vertexAttribPointer(slot, size, type, type !== gl.FLOAT, 28, at);
      gl.vertexAttribDivisor(slot, 1);
    }
    gl.bindVertexArray(null);
  }

  // Send a layer's geometry and textures to the graphics card.
  load(layer) {
    const { gl } = this, vao = gl.createVertexArray();
    gl.bindVertexArray(vao);
    const arrays = [[0, layer.places, 3, gl.FLOAT], [1, layer.colours, 4, gl.UNSIGNED_BYTE], [2, layer.uv, 2, gl.FLOAT],
      [3, layer.outward, 4, gl.BYTE]];
    for (const [slot, data, size, type] of arrays) {
      if (!data) continue;
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(slot);
      gl.vertexAttribPointer(slot, size, type, type !== gl.FLOAT, 0, 0);
    }
    gl.bindVertexArray(null);
    const groups = layer.images.length ? layer.images : [{ faces: layer.faces }];
    layer.drawn = { vao, paint: texture(gl, gl.NEAREST, gl.CLAMP_TO_EDGE), groups: groups.map(one => this.group(one)) };
  }

  group({ faces, bitmap }) {
    if (!bitmap) return { faces, image: this.white };
    const { gl } = this, image = texture(gl, gl.LINEAR_MIPMAP_LINEAR, gl.REPEAT);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, bitmap);
    gl.generateMipmap(gl.TEXTURE_2D);
    return { faces, image };
  }

  // Give a layer's faces their colours.
  paint(layer, colours) {
    const { gl } = this, rows = Math.max(Math.ceil(layer.faces / ROW), 1), padded = new Uint8Array(4 * ROW * rows);
    padded.set(colours);
    layer.paint4 = colours;
    gl.bindTexture(gl.TEXTURE_2D, layer.drawn.paint);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, ROW, rows, 0, gl.RGBA, gl.UNSIGNED_BYTE, padded);
  }

  // Lines from one end to the other, dots where both are the same: [from, to, colour, half the width in pixels].
  setStrokes(strokes) {
    const { gl } = this, data = new ArrayBuffer(28 * strokes.length), view = new DataView(data);
    strokes.forEach(([from, to, colour, width], k) => {
      [...from, ...to].forEach((value, j) => view.setFloat32(28 * k + 4 * j, value, true));
      [...colour, Math.min(8 * width, 255)].forEach((value, j) => view.setUint8(28 * k + 24 + j, value));
    });
    gl.bindBuffer(gl.ARRAY_BUFFER, this.lines.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.DYNAMIC_DRAW);
    this.lines.n = strokes.length;
  }

  draw(camera, layers, culls, cut) {
    const { gl, canvas } = this, pixel = Math.min(window.devicePixelRatio || 1, 2);
    const size = [canvas.clientWidth, canvas.clientHeight].map(side => Math.max(Math.round(side * pixel), 1));
    if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
    gl.viewport(0, 0, ...size);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    const matrix = camera.matrix(size[0] / size[1]);
    culls ? gl.enable(gl.CULL_FACE) : gl.disable(gl.CULL_FACE);
    gl.useProgram(this.faces.program);
    gl.uniformMatrix4fv(this.faces.at("view"), false, matrix);
    gl.uniform3fv(this.faces.at("eye"), camera.eye());
    gl.uniform1f(this.faces.at("cut"), cut);
    gl.uniform1f(this.faces.at("pixel"), pixel);
    gl.uniform1f(this.faces.at("wider"), WIDER * FARTHEST * 2 * Math.tan(camera.fov / 2) / size[1]);
    gl.uniform1i(this.faces.at("paint"), 0);
    gl.uniform1i(this.faces.at("image"), 1);
    for (const layer of layers) this.drawLayer(layer);
    gl.disable(gl.CULL_FACE);
    gl.useProgram(this.strokes.program);
    gl.uniformMatrix4fv(this.strokes.at("view"), false, matrix);
    gl.uniform2f(this.strokes.at("size"), size[0] / pixel, size[1] / pixel);
    gl.bindVertexArray(this.lines.vao);
    if (this.lines.n) gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, this.lines.n);
    gl.bindVertexArray(null);
    this.draws++;
    return matrix;
  }

  drawLayer({ drawn, colours }) {
    const { gl } = this;
    gl.bindVertexArray(drawn.vao);
    if (!colours) gl.vertexAttrib4f(1, 1, 1, 1, 1);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, drawn.paint);
    gl.activeTexture(gl.TEXTURE1);
    let first = 0;
    for (const { faces, image } of drawn.groups) {
      gl.bindTexture(gl.TEXTURE_2D, image);
      gl.drawArrays(gl.TRIANGLES, first, 3 * faces);
      first += 3 * faces;
    }
    gl.activeTexture(gl.TEXTURE0);
  }
}

function program(gl, vertex, fragment) {
  const made = gl.createProgram(), places = {};
  for (const [type, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made) || "no shaders");
  return { program: made, at: name => places[name] ??= gl.getUniformLocation(made, name) };
}

function texture(gl, smaller, beyond) {
  const made = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, made);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, smaller);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, smaller === gl.NEAREST ? gl.NEAREST : gl.LINEAR);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, beyond);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, beyond);
  return made;
}
