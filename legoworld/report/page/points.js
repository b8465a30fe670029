/* The surfaces themselves: points of the reference and of a submission, coloured by what R makes of
   them, from the reference's camera and free to orbit. */

import { depths } from "./depth.js";
import { button, counted, el } from "./elements.js";
import { orbitCanvas, orbitStage, pinholeEye, rendererOn, threeJs } from "./orbit.js";
import { bytesOf } from "./views.js";

const OUTSIDE = "outside";

/**
 * A choice for every side whose surface is known.
 * @param {BenchPageView} view
 * @param {Outcome[]} outcomes
 */
export function pointChoices(view, outcomes) {
  const many = view.sides.length > 1;
  return view.sides.map((side, k) => {
    let shown = null;
    const why = side.points && view.raster ? "" : side.why_no_picture || "there is no surface";
    return { key: "points" + k, title: "surfaces in 3D" + (many ? ": " + side.label : ""), why, 
      make: () => {
        const host = el("div", { class: "scene3d" }, [el("p", { class: "wait" }, ["loading the points"])]);
        host.style.setProperty("aspect-ratio", view.raster.size_wh.join(" / "));
        host.style.setProperty("--wide", String(view.raster.size_wh[0] / view.raster.size_wh[1]));
        Promise.resolve().then(() => { shown = openPoints(host, view.raster, side.points, outcomes); })
          .catch((error) => host.replaceChildren(el("p", { class: "wait" }, ["The points cannot be shown: " + error.message])));
        return el("div", {}, [host, el("p", { class: "over" }, [thinned(view.raster)])]);
      },
      close: () => { if (shown) { shown.close(); shown = null; } } };
  });
}

function thinned(raster) {
  const [w, h] = raster.size_wh;
  return raster.step === 1 ? "Every point of the scoring raster." :
    "Thinned for the page: every " + ["2nd", "3rd"][raster.step - 2] + " pixel each way, " + counted(w * h, "ray", "rays") +
    " of " + raster.n_raster.toLocaleString("en") + ". Scores use all.";
}

function openPoints(host, raster, points, outcomes) {
  const three = threeJs();
  const renderer = rendererOn(three, orbitCanvas("both surfaces as points"));
  const depth = { z0_m: raster.z0_m, step: raster.depth_step };
  const clouds = [["reference", raster.reference, points.reference_outcome],
    ["submission", points.submitted, points.submitted_outcome]].map(([name, codes, outcome]) =>
    ({ name, z: depths(codes, depth), outcome: bytesOf(outcome) }));
  const world = new three.Scene();
  const known = Array.from(clouds[0].z).filter((v) => !Number.isNaN(v)).sort((a, b) => a - b);
  const middle = known.length ? known[known.length >> 1] : 1;
  const far = clouds.reduce((most, c) => c.z.reduce((m, v) => v > m ? v : m, most), middle);
  const eye = pinholeEye(three, raster, middle / 200, far * 4 + 1);
  const colours = outcomes.map((o) => new three.Color(o.colour));
  const material = new three.PointsMaterial({ size: 3, sizeAttenuation: false, vertexColors: true });
  const parts = clouds.flatMap((cloud) => [false, true].map((outside) => {
    const made = new three.Points(pointsOf(three, raster, cloud, outcomes, colours, outside), material);
    made.frustumCulled = false;
    world.add(made);
    return { name: cloud.name, outside, made };
  }));
  const stage = orbitStage(three, { host, renderer, eye, world, target: new three.Vector3(0, 0, -middle),
    size_wh: raster.size_wh, before: () => {
      material.size = Math.max(2, host.clientWidth / raster.size_wh[0] * 1.3) * renderer.getPixelRatio();
    } });
  const shown = { reference: true, submission: true, "not scored": true };
  const switches = Object.keys(shown).map((name) => {
    const made = button(name, () => {
      shown[name] = !shown[name];
      made.setAttribute("aria-pressed", String(shown[name]));
      parts.forEach((p) => { p.made.visible = shown[p.name] && (!p.outside || shown["not scored"]); });
      stage.draw();
    }, { "aria-pressed": "true" });
    return made;
  });
  host.replaceChildren(renderer.domElement, el("div", { class: "scene-bar switches", role: "group", "aria-label": "points" },
    [...switches, button("camera", stage.home, { "aria-label": "back to the photo's camera" })]));
  stage.begin();
  return stage;
}

/* three's axes: y up, z backward; the raster's are y down, z forward. */
function pointsOf(three, raster, cloud, outcomes, colours, outside) {
  const places = [];
  const paints = [];
  const w = raster.size_wh[0];
  const at = (i) => {
    const z = cloud.z[i];
    return [(i % w + 0.5 - raster.cx) / raster.fx * z, -(Math.floor(i / w) + 0.5 - raster.cy) / raster.fy * z, -z];
  };
  cloud.z.forEach((z, i) => {
    const code = cloud.outcome[i];
    if (Number.isNaN(z) || !code || (outcomes[code].name === OUTSIDE) !== outside) { return; }
    const here = at(i);
    const light = shade(here, at(i + (i % w < w - 1 ? 1 : -1)), at(i + w < cloud.z.length ? i + w : i - w));
    places.push(...here);
    paints.push(colours[code].r * light, colours[code].g * light, colours[code].b * light);
  });
  const made = new three.BufferGeometry();
  made.setAttribute("position", new three.Float32BufferAttribute(places, 3));
  made.setAttribute("color", new three.Float32BufferAttribute(paints, 3));
  return made;
}

/* Darker where the surface turns away, so that its form is seen; flat where a neighbour is none. */
function shade(here, right, down) {
  const [a, b] = [right, down].map((other) => other.map((v, i) => v - here[i]));
  const normal = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const facing = Math.abs(normal[0] * 0.35 + normal[1] * 0.6 + normal[2] * 0.72) / Math.hypot(...normal);
  return Number.isFinite(facing) ? 0.3 + 0.7 * facing : 1;
}
