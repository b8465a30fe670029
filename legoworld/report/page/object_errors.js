/* Which objects of a scene the error of its depth is on: the scene is drawn once more, every object
   in a colour of its own, from the camera it was read out with. */

import { el } from "./elements.js";

const MOST_OBJECTS = 5;

/* The labelled object that a mesh is of, by its category key; else the mesh's own name. */
function ownerOf(mesh) {
  for (let node = mesh; node; node = node.parent) {
    if (node.userData.category) { return node.userData.name || node.name; }
  }
  return mesh.userData.name || mesh.name;
}

/* The index in names of what each of the picture's pixels shows, -1 where there is nothing. */
function objectPixels(three, scene, eye, [wide, high]) {
  const names = [];
  const own = [];
  scene.traverse((mesh) => {
    if (!mesh.isMesh) { return; }
    const name = ownerOf(mesh);
    if (!names.includes(name)) { names.push(name); }
    const code = names.indexOf(name) + 1;
    const emissive = new three.Color().setRGB((code >> 16) / 255, (code >> 8 & 255) / 255, (code & 255) / 255);
    own.push([mesh, mesh.material]);
    mesh.material = new three.MeshLambertMaterial({ color: 0, emissive, side: three.DoubleSide });
  });
  const renderer = new three.WebGLRenderer({ antialias: false, preserveDrawingBuffer: true });
  renderer.outputColorSpace = "srgb-linear";
  renderer.setPixelRatio(1);
  renderer.setSize(wide, high, false);
  renderer.setClearColor(0, 1);
  const world = new three.Scene();
  const parent = scene.parent;
  world.add(scene);
  renderer.render(world, eye);
  const rgba = new Uint8Array(4 * wide * high);
  const gl = renderer.getContext();
  gl.readPixels(0, 0, wide, high, gl.RGBA, gl.UNSIGNED_BYTE, rgba);
  parent.add(scene);
  own.forEach(([mesh, material]) => { mesh.material.dispose(); mesh.material = material; });
  renderer.dispose();
  renderer.forceContextLoss();
  const pixels = Int32Array.from({ length: wide * high }, (_, i) => {
    const at = 4 * ((high - 1 - Math.floor(i / wide)) * wide + i % wide);
    return (rgba[at] << 16 | rgba[at + 1] << 8 | rgba[at + 2]) - 1;
  });
  return { names, pixels };
}

/* The objects by their share of the error; relative: |error| / truth of each pixel. */
export function objectErrors(three, scene, eye, size, relative) {
  const { names, pixels } = objectPixels(three, scene, eye, size);
  const found = names.map((name) => ({ name, n: 0, sum: 0 }));
  let all = 0;
  relative.forEach((error, i) => {
    if (Number.isNaN(error)) { return; }
    all += error;
    if (found[pixels[i]]) { found[pixels[i]].n += 1; found[pixels[i]].sum += error; }
  });
  const worst = found.filter((one) => one.sum > 0).sort((a, b) => b.sum - a.sum).slice(0, MOST_OBJECTS);
  return el("p", { class: "object-errors" }, ["the error is on ", ...worst.flatMap((one, i) => [i ? ", " : "", el("b", {}, [one.name]),
    " " + (100 * one.sum / all).toFixed(0) + " % (AbsRel " + (one.sum / one.n).toFixed(3) + ")"])]);
}
