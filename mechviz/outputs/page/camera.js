/* Matrices (column-major, as in WebGL) and a camera that orbits a target. */

const FIELD = (24 * Math.PI) / 180; // vertical; little perspective, so that lengths can be compared
const MARGIN = 1.07;
const WIDER = 1.22; // largest distance of the view over that of the mechanism alone: limits the room for arrows
// flat: orthographic; pans: dragging moves the picture instead of rotating it, and the grid stands behind the mechanism
const VIEWS = {
  front: { yaw: 0, pitch: 0, flat: true, pans: true },
  "3d": { yaw: -0.42, pitch: 0.3, flat: false, pans: false },
  iso: { yaw: -Math.PI / 4, pitch: Math.atan(Math.SQRT1_2), flat: true, pans: false },
  top: { yaw: 0, pitch: Math.PI / 2, flat: true, pans: false },
  left: { yaw: -Math.PI / 2, pitch: 0, flat: true, pans: false },
  right: { yaw: Math.PI / 2, pitch: 0, flat: true, pans: false },
  back: { yaw: Math.PI, pitch: 0, flat: true, pans: true },
};

function times(a, b) {
  const out = new Float32Array(16);
  for (let c = 0; c < 4; c++)
    for (let r = 0; r < 4; r++) {
      let sum = 0;
      for (let k = 0; k < 4; k++) sum += a[4 * k + r] * b[4 * c + k];
      out[4 * c + r] = sum;
    }
  return out;
}

class Camera {
  constructor(bounds, core) {
    this.bounds = bounds;
    this.core = core; // the box that must be large in the picture
    this.size = Math.max(bounds[1][0] - bounds[0][0], bounds[1][1] - bounds[0][1], 1e-9);
    this.target = [0, 0, 0];
    this.distance = 1;
    this.aspect = 1;
    this.fitted = true; // until the user moves it
    this.covered = 0; // fraction of the picture's height that buttons cover at its top
    Object.assign(this, VIEWS["3d"]);
  }

  /** Unit vectors to the right, up and towards the camera. */
  axes() {
    const [sy, cy, sp, cp] = [Math.sin(this.yaw), Math.cos(this.yaw), Math.sin(this.pitch), Math.cos(this.pitch)];
    return { right: [cy, 0, -sy], up: [-sp * sy, cp, -sp * cy], back: [cp * sy, sp, cp * cy] };
  }

  look(name) {
    Object.assign(this, VIEWS[name]);
    this.fit();
  }

  /** Fits the bounds in the picture; they are reduced towards the core as far as necessary for the core to be large. */
  fit() {
    const most = WIDER * this.fitTo(this.core);
    for (let part = 1; part > 0; part -= 1 / 16)
      if (this.fitTo(this.core.map((corner, k) => corner.map((v, i) => v + part * (this.bounds[k][i] - v)))) <= most) return;
    this.fitTo(this.core);
  }

  /** Fits a box in the picture, with the least distance of the camera that shows every corner; returns the distance. */
  fitTo([low, high]) {
    const middle = low.map((v, k) => 0.5 * (v + high[k]));
    const { right, up, back } = this.axes();
    const tan = Math.tan(FIELD / 2);
    const free = 1 - this.covered;
    const corners = [...Array(8).keys()].map((n) => [0, 1, 2].map((k) => ((n >> k) & 1 ? high[k] : low[k]) - middle[k]));
    const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    const spans = corners.map((c) => [dot(c, right), dot(c, up), dot(c, back)]);
    let distance = 1e-9;
    for (const [x, y, z] of spans)
      distance = Math.max(distance, (this.flat ? 0 : z) + (MARGIN * Math.max(Math.abs(x) / this.aspect, Math.abs(y) / free)) / tan);
    this.target = middle.map((v, k) => v + this.covered * distance * tan * up[k]); // in the middle of the free part
    this.distance = distance;
    this.fitted = true;
    return distance;
  }

  resize(aspect) {
    this.aspect = aspect;
    if (this.fitted) this.fit();
  }

  turn(dx, dy) {
    this.fitted = false;
    if (this.pans) this.flat = this.pans = false;
    this.yaw -= dx;
    this.pitch = Math.min(Math.PI / 2, Math.max(-Math.PI / 2, this.pitch + dy));
  }

  /** Moves the picture by fractions of its height. */
  pan(dx, dy) {
    this.fitted = false;
    const height = 2 * this.distance * Math.tan(FIELD / 2);
    const { right, up } = this.axes();
    this.target = this.target.map((v, k) => v - height * (dx * right[k] - dy * up[k]));
  }

  zoom(factor) {
    this.fitted = false;
    this.distance = Math.min(Math.max(this.distance / factor, 0.05 * this.size), 50 * this.size);
  }

  /** Transformation from world to clip space, position of the camera, and direction towards it. */
  matrices() {
    const { right, up, back } = this.axes();
    const eye = this.target.map((v, k) => v + this.distance * back[k]);
    const dot = (a) => -(a[0] * eye[0] + a[1] * eye[1] + a[2] * eye[2]);
    const view = new Float32Array([
      right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0, dot(right), dot(up), dot(back), 1,
    ]);
    const near = Math.max(0.02 * this.distance, this.distance - 4 * this.size);
    const far = this.distance + 6 * this.size;
    const f = 1 / Math.tan(FIELD / 2);
    const lens = new Float32Array(16);
    if (this.flat) {
      const half = this.distance / f;
      lens.set([1 / (half * this.aspect), 0, 0, 0, 0, 1 / half, 0, 0, 0, 0, -2 / (far - near), 0, 0, 0, -(far + near) / (far - near), 1]);
    } else {
      lens.set([f / this.aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, -(far + near) / (far - near), -1, 0, 0, (-2 * far * near) / (far - near), 0]);
    }
    return { clip: times(lens, view), eye, back };
  }
}
