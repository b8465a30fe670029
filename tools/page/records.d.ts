// Made by docs/page_types.py from legoworld/records: do not edit.

/** One finding. level: bad costs score, warn may, note explains. do: what helps, if anything. */
interface Advice {
  level: "bad" | "note" | "warn";
  what: string;
  do: string;
  truths: Array<number>;
  predictions: Array<number>;
}

/** What one side made of a photo. scene: of a side that reads scenes, where they were given. */
interface Answer {
  label: string;
  status: string;
  facts: Array<[string, string]>;
  tables: Array<FactTable>;
  advice: Array<Advice>;
  scene: PageScene | null;
}

/** One side's numbers of a category. */
interface CategoryCell {
  ap: number | null;
  ap50: number | null;
  miou: number | null;
  n: number;
  tp: number;
  fp: number;
}

/** A category, a cell of each side that has truth or predictions of it. */
interface CategoryLine {
  id: number;
  name: string;
  frequency: string | null;
  n_truth: number;
  n_images: number;
  cells: Array<CategoryCell | null>;
}

/** Errors of one kind in one category, of one side. name, category: what lists their photos. */
interface Cost {
  kind: string;
  category: number;
  name: string;
  n: number;
  images: number;
  text: string;
}

/** All attempted images of a side, each in one part. */
interface CoverageBar {
  label: string;
  attempted: number;
  parts: Array<CoveragePart>;
}

/** Images of one sort. sort: what its colour says. */
interface CoveragePart {
  name: string;
  sort: "empty" | "failed" | "scored";
  n: number;
}

/** Of depth; None where it has no score. */
interface DepthCell {
  status: string;
  advice: string;
  findings: number;
  abs_rel: Record<string, number> | null;
  delta1: number | null;
  constant: number | null;
  holes: number | null;
}

/** The drawn arrays of one photo on one scale. */
interface DepthDrawing {
  size_wh: [number, number];
  image_wh: [number, number];
  near_far_z_m: [number, number];
  error_m: number;
  z0_m: number;
  step: number;
  truth: string;
  aligned: Array<string | null>;
}

/** |aligned - truth| / truth by true depth, over the drawn pixels of all scored photos. */
interface DepthError {
  label: string;
  edges_m: Array<number>;
  n: Array<number>;
  low: Array<number | null>;
  median: Array<number | null>;
  high: Array<number | null>;
}

/** A photo of depth. depth: None where no side scored. */
interface DepthPageView {
  section: string;
  id: number;
  file_name: string;
  size_wh: [number, number];
  photo: number | null;
  said: string;
  sides: Array<Answer>;
  depth: DepthDrawing | null;
}

/** Its boxes or masks. truth: what became of each truth. */
interface DetectionAnswer {
  label: string;
  status: string;
  facts: Array<[string, string]>;
  tables: Array<FactTable>;
  advice: Array<Advice>;
  scene: PageScene | null;
  predictions: Array<DrawnPrediction>;
  truth: Array<string>;
}

/** Of boxes or masks. errors: kind and category id of its errors, each pair once. */
interface DetectionCell {
  status: string;
  advice: string;
  findings: number;
  quality: number | null;
  tp: number;
  fp: number;
  fn: number;
  errors: Array<[string, number]>;
}

/** A photo of boxes or masks. */
interface DetectionPageView {
  section: string;
  id: number;
  file_name: string;
  size_wh: [number, number];
  photo: number | null;
  said: string;
  sides: Array<DetectionAnswer>;
  truths: Array<Drawn>;
}

/** A truth as it is drawn. */
interface Drawn {
  c: number;
  box: Array<number>;
  rle: string;
  polygons: Array<Array<number>>;
}

/** A prediction. s: score; o: outcome at IoU 0.5; k: error kind; t: truth meant; i: IoU. */
interface DrawnPrediction {
  c: number;
  box: Array<number>;
  rle: string;
  polygons: Array<Array<number>>;
  n: string;
  m: Array<string>;
  s: number;
  o: string;
  k: string | null;
  t: number | null;
  i: number | null;
}

/** One side's errors, and images with them, by kind. reached: truths that an error reaches. */
interface ErrorCounts {
  label: string;
  counts: Record<string, number>;
  images: Record<string, number>;
  reached: number;
}

/** A small table of texts. */
interface FactTable {
  title: string;
  head: Array<string>;
  rows: Array<Array<string>>;
}

/** What is read before anything else. */
interface FirstScreen {
  verdicts: Array<Verdict>;
  costs: Array<SideCosts>;
  forest: Array<ForestRow>;
  coverage: Array<CoverageBar>;
}

/** A metric: a span of each side, and of the difference to each other side. */
interface ForestRow {
  name: string;
  better: "higher" | "lower";
  sides: Array<Span | null>;
  differences: Array<Span | null>;
}

/** IoU of predictions with the ground truth of their category that they are about. */
interface IouHistogram {
  label: string;
  edges: Array<number>;
  tp: Array<number>;
  low: Array<number>;
}

/** The camera a scene was read out with. world_from_cam: 3 x 4, z up, the camera's z forward. */
interface PageCamera {
  world_from_cam: Array<Array<number>>;
  fx: number;
  fy: number;
  cx: number;
  cy: number;
  orthographic: boolean;
  size_wh: [number, number];
}

/** What the page shows of a scene folder. */
interface PageScene {
  render: number | null;
  render_said: string;
  glb: number | null;
  glb_said: string;
  camera: PageCamera | null;
}

/** A section: evaluations of one task over one truth, or a comparison alone. */
interface PageSection {
  key: string;
  task: string;
  title: string;
  sides: Array<SideHead>;
  first: FirstScreen;
  categories: Array<CategoryLine>;
  errors: Array<ErrorCounts>;
  names: Record<string, string>;
  images: Array<PhotoRow>;
  plots: Plots;
}

/** One side of a photo in the list. advice: the first finding; findings: how many are bad. */
interface PhotoCell {
  status: string;
  advice: string;
  findings: number;
}

/** A photo in the list. view: its place in the page's views. */
interface PhotoRow {
  id: number;
  file_name: string;
  view: number;
  n_truth: number;
  cells: Array<PhotoCell>;
  categories: Array<number>;
}

/** Curves and histograms; empty where a task has none. */
interface Plots {
  precision_recall: Array<PrecisionRecall>;
  iou: Array<IouHistogram>;
  depth_error: Array<DepthError>;
}

/** Precision at the 101 recall thresholds at IoU 0.5, the mean over categories with truth. */
interface PrecisionRecall {
  label: string;
  policy: "equal confidence" | "own scores";
  categories: number;
  precision: Array<number>;
  low: Array<number>;
  high: Array<number>;
  draws: number;
}

/** What costs a side most, the most first. n: all its errors. */
interface SideCosts {
  label: string;
  n: number;
  most: Array<Cost>;
}

/** One side. used_truth: whether its prompts came from the truth. */
interface SideHead {
  label: string;
  scene: boolean;
  used_truth: boolean;
}

/** A number and the ends of its interval, None where it has none. over: its denominators. */
interface Span {
  value: number | null;
  low: number | null;
  high: number | null;
  over: string;
}

/** One sentence with its denominators. standing: of the first side named. */
interface Verdict {
  sentence: string;
  standing: "alone" | "better" | "no interval" | "not told apart" | "worse";
}

interface PageData {
  sections: PageSection[];
  views: [string, number][];
  kinds: string[];
  beside: { folder: string; pictures: boolean; scenes: boolean };
  version: string;
}

/** What selectors find is known by the page's own templates, not by its type. */
interface ParentNode {
  querySelector(selectors: string): any;
  querySelectorAll(selectors: string): NodeListOf<any>;
}

interface Window {
  legoworldView(at: number, view: any): void;
  legoworldScene(at: number, text: string): void;
  legoworldThree(): any;
}
