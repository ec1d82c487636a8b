// Camera: turns about a target, z up; columns of matrices one after the other, as WebGL wants them.

const FOV = 32 * Math.PI / 180, STEEPEST = 89.5 * Math.PI / 180, MOST_POINTS = 1500;

class Camera {
  constructor({ size, focus, look, cut, layers }) {
    const top = cut === null ? Infinity : Math.max(cut, focus[0][2]); // what is cut off at first need not be in the picture
    Object.assign(this, { size, focus: focus.map(end => [end[0], end[1], Math.min(end[2], top)]) });
    this.look = look; // yaw and pitch
    this.points = sampled(layers, this.focus);
    this.radius = Math.max(Math.hypot(...size) / 2, 1e-3);
    this.home(1);
  }

  // The whole model from the side from which it is to be seen first, as large as it fits.
  home(aspect) {
    Object.assign(this, { yaw: this.look[0], pitch: this.look[1], fov: FOV, distance: 3 * this.radius });
    this.target = [0, 1, 2].map(axis => (this.focus[0][axis] + this.focus[1][axis]) / 2);
    const tangent = Math.tan(FOV / 2);
    for (let round = 0; round < 12; round++) {
      const [right, up, back] = this.axes(), eye = this.eye();
      const seen = this.points.map(point => {
        const way = point.map((place, axis) => place - eye[axis]), depth = Math.max(-dot(way, back), 0.02 * this.radius);
        return [dot(way, right) / depth / tangent / aspect, dot(way, up) / depth / tangent];
      });
      const [x, y] = [0, 1].map(axis => seen.map(place => place[axis])), middle = all => (Math.max(...all) + Math.min(...all)) / 2;
      this.shift(middle(x) * aspect / 2, middle(y) / 2);
      const half = Math.max(...[x, y].map(all => (Math.max(...all) - Math.min(...all)) / 2));
      this.distance = Math.max(this.distance * (1 + 0.8 * (half / 0.94 - 1)), 0.05 * this.radius);
    }
  }

  // Right, up and back, unit vectors of the world.
  axes() {
    const [cy, sy] = [Math.cos(this.yaw), Math.sin(this.yaw)], [cp, sp] = [Math.cos(this.pitch), Math.sin(this.pitch)];
    return [[-sy, cy, 0], [-sp * cy, -sp * sy, cp], [cp * cy, cp * sy, sp]];
  }

  eye() {
    const back = this.axes()[2];
    return this.target.map((place, axis) => place + this.distance * back[axis]);
  }

  turn(yaw, pitch) {
    this.yaw += yaw;
    this.pitch = Math.min(Math.max(this.pitch + pitch, -STEEPEST), STEEPEST);
  }

  // Shift by shares of the picture's height.
  shift(across, along) {
    const [right, up] = this.axes(), scale = 2 * this.distance * Math.tan(this.fov / 2);
    this.target = this.target.map((place, axis) => place + scale * (across * right[axis] + along * up[axis]));
  }

  zoom(factor) {
    this.distance = Math.min(Math.max(this.distance * factor, 1e-3 * this.radius), 20 * this.radius);
  }

  // Stand where a station stands and look where it looks; it may then be turned about what is in its middle.
  standAt(marker) {
    const forward = marker.axes[2];
    this.distance = 0.12 * this.radius;
    this.target = marker.at.map((place, axis) => place + this.distance * forward[axis]);
    this.yaw = Math.atan2(-forward[1], -forward[0]);
    this.pitch = Math.min(Math.max(Math.asin(-forward[2]), -STEEPEST), STEEPEST);
    this.fov = marker.slope ? Math.min(2 * Math.atan(1.05 * marker.slope[1]), 1.9) : 1.6;
  }

  state() {
    return [...this.target, this.yaw, this.pitch, Math.log(this.distance), this.fov];
  }

  // Go a share of the way from one state to another.
  between(from, to, share) {
    const mixed = from.map((value, k) => value + share * (to[k] - value));
    this.target = mixed.slice(0, 3);
    [this.yaw, this.pitch] = [mixed[3], mixed[4]];
    this.distance = Math.exp(mixed[5]);
    this.fov = mixed[6];
  }

  matrix(aspect) {
    const [right, up, back] = this.axes(), eye = this.eye();
    const middle = this.size.map((side, axis) => side / 2 - eye[axis]), depth = -dot(middle, back);
    const far = Math.max(depth + 1.6 * this.radius, 0.1 * this.radius);
    const near = Math.max(0.9 * (depth - 1.6 * this.radius), 2e-3 * this.radius);
    const scale = 1 / Math.tan(this.fov / 2), spread = near - far;
    const rows = [
      [...right.map(part => part * scale / aspect), -dot(right, eye) * scale / aspect],
      [...up.map(part => part * scale), -dot(up, eye) * scale],
      [...back.map(part => part * (far + near) / spread), (2 * far * near - dot(back, eye) * (far + near)) / spread],
      [...back.map(part => -part), dot(back, eye)],
    ];
    return Float32Array.from({ length: 16 }, (_, k) => rows[k % 4][k >> 2]);
  }

  // The ray through a place of the picture, both coordinates from -1 to 1, up positive.
  ray(x, y, aspect) {
    const [right, up, back] = this.axes(), tangent = Math.tan(this.fov / 2);
    return right.map((part, axis) => part * x * tangent * aspect + up[axis] * y * tangent - back[axis]);
  }
}

// Places that are to be in the picture: evenly spread corners of the faces that are shown, moved into the bounds.
function sampled(layers, bounds) {
  const found = [];
  for (const { places } of layers.filter(layer => layer.shown)) {
    const step = Math.max(Math.floor(places.length / 3 / MOST_POINTS), 1);
    for (let at = 0; at < places.length; at += 3 * step) {
      const point = [...places.subarray(at, at + 3)];
      found.push(point.map((place, axis) => Math.min(Math.max(place, bounds[0][axis]), bounds[1][axis])));
    }
  }
  return found.length ? found : bounds;
}

function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// Where a point is seen: from -1 to 1 across and up, null behind the eye.
function projected(matrix, [x, y, z]) {
  const at = row => matrix[row] * x + matrix[4 + row] * y + matrix[8 + row] * z + matrix[12 + row];
  const w = at(3);
  return w > 1e-6 ? [at(0) / w, at(1) / w] : null;
}
