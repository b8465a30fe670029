/* A canvas of three.js with a camera to orbit: by pointer, by keys, and back to where it was. */

import { el } from "./elements.js";

export const ORBIT_HINT = ": drag or use the arrow keys to orbit, wheel or + and - to come nearer, 0 for the photo's camera";

const KEPT_THREE = [];

/* three.js, run once: of two copies each would have classes of its own. */
export function threeJs() {
  if (!KEPT_THREE.length) { KEPT_THREE.push(window.legoworldThree()); }
  return KEPT_THREE[0];
}

export function orbitCanvas(what) { return el("canvas", { tabindex: 0, "aria-label": what + ORBIT_HINT }); }

export function rendererOn(three, canvas) {
  try {
    return new three.WebGLRenderer({ canvas, antialias: true, alpha: true, preserveDrawingBuffer: true });
  } catch {
    throw new Error("this browser gives no WebGL");
  }
}

/* Draws world through eye, which looks at target; before: called ahead of every drawing. */
export function orbitStage(three, { host, renderer, eye, world, target, size_wh, before }) {
  const canvas = renderer.domElement;
  const start = { position: eye.position.clone(), quaternion: eye.quaternion.clone(), target };
  // Turns the camera to the origin at once: `home` turns it back.
  const controls = new three.OrbitControls(eye, canvas);
  controls.enableDamping = false;
  function draw() {
    if (before) { before(); }
    renderer.render(world, eye);
  }
  function home() {
    controls.target.copy(start.target);
    eye.position.copy(start.position);
    eye.quaternion.copy(start.quaternion);
    draw();
  }
  controls.addEventListener("change", draw);
  const watcher = new ResizeObserver(() => {
    const box = host.getBoundingClientRect();
    renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    renderer.setSize(Math.max(box.width, 1), Math.max(box.width * size_wh[1] / size_wh[0], 1), false);
    draw();
  });
  canvas.addEventListener("keydown", (event) => { if (orbitKey(three, eye, controls, event.key, home)) { event.preventDefault(); } });
  return {
    draw, home,
    begin() { home(); watcher.observe(host); host.dataset.ready = "yes"; },
    close() {
      watcher.disconnect();
      controls.dispose();
      world.traverse((node) => { if (node.geometry) { node.geometry.dispose(); } });
      renderer.dispose();
      renderer.forceContextLoss();
    },
  };
}

/* Arrow keys orbit by steps, + and - come nearer, 0 goes home. */
function orbitKey(three, eye, controls, key, home) {
  const turns = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  const offset = eye.position.clone().sub(controls.target);
  if (key === "0") { home(); return true; }
  if (key === "+" || key === "=") { offset.multiplyScalar(0.85); }
  else if (key === "-") { offset.multiplyScalar(1.18); }
  else if (turns[key]) {
    const around = new three.Spherical().setFromVector3(offset);
    around.theta += turns[key][0] * 0.12;
    around.phi = Math.min(Math.max(around.phi + turns[key][1] * 0.12, 0.05), 3.09);
    offset.setFromSpherical(around);
  } else { return false; }
  eye.position.copy(controls.target).add(offset);
  controls.update();
  return true;
}

/* Pixels of size_wh through fx, fy, cx, cy, from near to far. */
export function pinholeEye(three, lens, near, far) {
  const [w, h] = lens.size_wh;
  const eye = new three.PerspectiveCamera(2 * Math.atan(h / 2 / lens.fy) * 180 / Math.PI, w / h, near, far);
  eye.updateProjectionMatrix();
  eye.projectionMatrix.set(2 * lens.fx / w, 0, 1 - 2 * lens.cx / w, 0, 0, 2 * lens.fy / h,
    2 * lens.cy / h - 1, 0, 0, 0, -(far + near) / (far - near), -2 * far * near / (far - near), 0, 0, -1, 0);
  eye.projectionMatrixInverse.copy(eye.projectionMatrix).invert();
  return eye;
}
