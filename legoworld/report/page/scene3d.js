/* The scene itself: scene.glb from the photo's camera, free to orbit, coloured by outcome. */

import { depthErrors } from "./depth.js";
import { button, el } from "./elements.js";
import { objectErrors } from "./object_errors.js";
import { orbitCanvas, orbitStage, pinholeEye, rendererOn, threeJs } from "./orbit.js";
import { WORDS } from "./outcomes.js";
import { bytesOf, leftBehind, withScene } from "./views.js";

const COLOURS = { tp: 0x2f8fd0, fp: 0xe8641b, other: 0xb9bec4, none: 0x8d9399, hot: 0xffffff };

/* A choice for every side whose scene folder is known. */
export function sceneChoices(view, items, links) {
  const several = view.sides.filter((s) => s.scene).length > 1;
  return view.sides.flatMap((side, k) => {
    if (!side.scene) { return []; }
    const { glb, glb_said, camera } = side.scene;
    const why = glb === null ? glb_said : camera ? "" : "the run recorded no camera";
    let shown = null;
    return [{ group: view.objects && several ? side.label : "", key: "scene" + k, short: view.objects ? "scene in 3D" : undefined, title: "scene in 3D" + (several ? " of " + side.label : ""), why, usual: true,
      make: () => {
        const host = el("div", { class: "scene3d" }, [el("p", { class: "wait" }, ["loading the scene"])]);
        host.style.setProperty("aspect-ratio", view.size_wh.join(" / "));
        host.style.setProperty("--wide", String(view.size_wh[0] / view.size_wh[1]));
        const fail = (text) => host.replaceChildren(el("p", { class: "wait" }, [text]));
        withScene(glb, (text) => {
          Promise.resolve().then(() => openScene(host, text, camera, items.filter((i) => i.side === k), links,
            depthErrors(view.depth, k), view))
            .then((made) => { shown = made; })
            .catch((error) => fail("The scene cannot be shown: " + error.message));
        }, () => fail("The scene is not here: " + leftBehind()));
        return view.depth ? el("div", {}, [host]) : host;
      },
      close: () => { if (shown) { shown.close(); shown = null; } } }];
  });
}

/**
 * A scene in a host, from a camera or from its own first one, coloured by its items' outcomes.
 * @param {any} host
 * @param {any} [links]
 * @param {any} [errors]
 * @param {any} [view]
 * @returns {Promise<any>}
 */
export async function openScene(host, text, camera = null, items = [], links = null, errors = null, view = null) {
  const three = threeJs();
  const canvas = orbitCanvas("the scene in 3D");
  const renderer = rendererOn(three, canvas);
  const gltf = await parsed(three, text);
  const world = new three.Scene();
  world.add(gltf.scene, new three.HemisphereLight(0xffffff, 0x8a8378, 2.4));
  const eye = camera ? cameraOf(three, camera, gltf.scene) : ownCamera(gltf);
  if (errors) { host.after(objectErrors(three, gltf.scene, eye, view.depth.size_wh, errors.relative)); }
  const sun = new three.DirectionalLight(0xffffff, 1.6);
  sun.position.set(0.5, 1, 1);
  eye.add(sun);
  world.add(eye);
  const bodies = bodiesOf(gltf.scene, items);
  const state = { plain: !items.length, lit: new Set() };
  const stage = orbitStage(three, { host, renderer, eye, world, target: ahead(three, eye, gltf.scene),
    size_wh: camera ? camera.size_wh : [eye.aspect, 1], before: () => paint(three, bodies, state) });
  const colours = button("materials", () => {
    state.plain = !state.plain;
    colours.textContent = state.plain ? "outcomes" : "materials";
    stage.draw();
  });
  const back = button("photo's camera", stage.home);
  const key = el("span", { class: "scene-key" }, (items.length ? ["tp", "fp"] : []).map((layer) => el("span", {}, [
    el("span", { class: "key k-" + layer }), " " + WORDS[layer] + " "])));
  if (links) {
    pickable(three, canvas, eye, bodies, links);
    links.listen((lit) => { state.lit = lit; stage.draw(); });
  }
  host.replaceChildren(canvas, el("div", { class: "scene-bar" }, [key, items.length ? colours : null, back]));
  stage.begin();
  return stage;
}

/* The first camera of the file, apart from its place among the nodes. */
function ownCamera(gltf) {
  const own = gltf.cameras[0];
  if (!own || !own.aspect) { throw new Error("it has no camera in perspective"); }
  own.updateWorldMatrix(true, false);
  const eye = own.clone();
  own.matrixWorld.decompose(eye.position, eye.quaternion, eye.scale);
  return eye;
}

function parsed(three, text) {
  const loader = new three.GLTFLoader();
  loader.register((parser) => ({ name: "legoworld_textures", loadTexture: (index) => textureOf(three, parser, index) }));
  return new Promise((resolve, reject) => loader.parse(bytesOf(text).buffer, "", resolve, reject));
}

/* Pictures inside the file as data: addresses, which the page's policy allows; blob: it does not. */
async function textureOf(three, parser, index) {
  const wanted = parser.json.textures[index];
  const webp = wanted.extensions && wanted.extensions.EXT_texture_webp;
  const image = parser.json.images[webp ? webp.source : wanted.source];
  let url = image.uri;
  if (image.bufferView !== undefined) {
    const bytes = new Uint8Array(await parser.getDependency("bufferView", image.bufferView));
    let binary = "";
    for (let i = 0; i < bytes.length; i += 8192) { binary += String.fromCharCode(...bytes.subarray(i, i + 8192)); }
    url = "data:" + (image.mimeType || "image/png") + ";base64," + btoa(binary);
  }
  const element = new Image();
  element.src = url;
  await element.decode();
  const texture = new three.Texture(element);
  const sampler = (parser.json.samplers || {})[wanted.sampler] || {};
  const wraps = { 33071: three.ClampToEdgeWrapping, 33648: three.MirroredRepeatWrapping };
  texture.wrapS = wraps[sampler.wrapS] || three.RepeatWrapping;
  texture.wrapT = wraps[sampler.wrapT] || three.RepeatWrapping;
  texture.flipY = false;
  texture.needsUpdate = true;
  parser.associations.set(texture, { textures: index });
  return texture;
}

/* The camera the scene was read out with. Ours: z up, camera y down and z forward; glTF's: y up,
   camera y up and z backward. */
function cameraOf(three, camera, scene) {
  const [w, h] = camera.size_wh;
  const m = camera.world_from_cam;
  const turned = (c, sign) => [sign * m[0][c], sign * m[2][c], -sign * m[1][c]];
  const [right, up, back, at] = [turned(0, 1), turned(1, -1), turned(2, -1), turned(3, 1)];
  const sphere = sphereOf(three, scene);
  const far = 4 * (sphere.radius + sphere.center.distanceTo(new three.Vector3(...at))) + 1;
  const near = far / 20000;
  let eye;
  if (camera.orthographic) {
    eye = new three.OrthographicCamera(-camera.cx / camera.fx, (w - camera.cx) / camera.fx,
      camera.cy / camera.fy, -(h - camera.cy) / camera.fy, near, far);
  } else {
    eye = pinholeEye(three, camera, near, far);
  }
  eye.position.set(...at);
  eye.quaternion.setFromRotationMatrix(new three.Matrix4().makeBasis(
    new three.Vector3(...right), new three.Vector3(...up), new three.Vector3(...back)));
  eye.updateMatrixWorld();
  return eye;
}

function sphereOf(three, scene) {
  return new three.Box3().setFromObject(scene).getBoundingSphere(new three.Sphere());
}

/* What is turned around: what stands in the middle of the picture, else the scene's middle. */
function ahead(three, eye, scene) {
  const ray = new three.Raycaster();
  ray.setFromCamera(new three.Vector2(0, 0), eye);
  const hit = ray.intersectObject(scene, true)[0];
  const forward = eye.getWorldDirection(new three.Vector3());
  const middle = sphereOf(three, scene).center.sub(eye.position).dot(forward);
  return forward.multiplyScalar(hit ? hit.distance : Math.max(middle, 1)).add(eye.position);
}

/* Every mesh with the item whose objects it is of. */
function bodiesOf(scene, items) {
  const byName = new Map();
  items.forEach((item) => (item.shape.m || []).forEach((name) => byName.set(name, item)));
  const bodies = [];
  scene.traverse((mesh) => {
    if (!mesh.isMesh) { return; }
    let [node, item] = [mesh, null];
    while (node && !item) {
      item = byName.get(node.userData.name) || null;
      node = node.parent;
    }
    bodies.push({ mesh, item, own: mesh.material });
  });
  return bodies;
}

const PAINTS = new Map();

function paintOf(three, name, glow) {
  const key = name + glow;
  if (!PAINTS.has(key)) {
    PAINTS.set(key, new three.MeshLambertMaterial({ color: COLOURS[name], side: three.DoubleSide,
      emissive: glow ? COLOURS[name] : 0, emissiveIntensity: glow ? 0.55 : 0, transparent: name === "none",
      opacity: name === "none" ? 0.55 : 1, depthWrite: true }));
  }
  return PAINTS.get(key);
}

function paint(three, bodies, state) {
  bodies.forEach(({ mesh, item, own }) => {
    const lit = Boolean(item && state.lit.has(item.id));
    mesh.material = state.plain && !lit ? own : paintOf(three, item ? item.layer : "none", lit);
  });
}

/* A click on a body keeps it, in the picture, too; the pointer over it lights it up. */
function pickable(three, canvas, eye, bodies, links) {
  const ray = new three.Raycaster();
  const meshes = bodies.map((b) => b.mesh);
  const at = (event) => {
    const box = canvas.getBoundingClientRect();
    ray.setFromCamera(new three.Vector2((event.clientX - box.left) / box.width * 2 - 1,
      1 - (event.clientY - box.top) / box.height * 2), eye);
    const hit = ray.intersectObjects(meshes, false)[0];
    const body = hit && bodies.find((b) => b.mesh === hit.object);
    return body && body.item ? [body.item.id] : [];
  };
  let down = null;
  canvas.addEventListener("pointerdown", (event) => { down = [event.clientX, event.clientY]; });
  canvas.addEventListener("pointerup", (event) => {
    if (!down || Math.hypot(event.clientX - down[0], event.clientY - down[1]) > 4) { return; }
    const ids = at(event);
    if (ids.length) { links.pin(ids); } else { links.release(); }
  });
}
