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

/** One submission. */
interface BenchAnswer {
  label: string;
  status: string;
  facts: Array<[string, string]>;
  tables: Array<FactTable>;
  advice: Array<Advice>;
  scene: PageScene | null;
  objects: Array<ObjectScore>;
  checks: Array<CheckLine>;
  hit_picture: number | null;
  error_picture: number | null;
  why_no_picture: string;
  points: BenchPoints | null;
}

/** One side of a case in the list. flags: kinds, each once. */
interface BenchCell {
  status: string;
  advice: string;
  findings: number;
  valid: boolean;
  R: number | null;
  A: number | null;
  S: number | null;
  flags: Array<"appearance_without_geometry" | "camera_facing_planes" | "compositor_nodes" | "drivers" | "picture_in_scene" | "picture_in_world" | "text_blocks" | "view_drop">;
}

/** A scored object where the reference shows it, in raster pixels. n: its name. */
interface BenchObject {
  c: number;
  box: Array<number>;
  rle: string;
  polygons: Array<Array<number>>;
  n: string;
}

/** A case. size_wh: of the scoring raster, which everything is drawn in. */
interface BenchPageView {
  section: string;
  id: number;
  file_name: string;
  size_wh: [number, number];
  photo: number | null;
  said: string;
  sides: Array<BenchAnswer>;
  objects: Array<BenchObject>;
  raster: BenchRaster | null;
}

/** One side's points. submitted: base64 of uint16 depth codes. */
interface BenchPoints {
  submitted: string;
  reference_outcome: string;
  submitted_outcome: string;
}

/** The pixel grid of the drawn points: every `step`-th pixel of the scoring raster each way. */
interface BenchRaster {
  size_wh: [number, number];
  step: number;
  n_raster: number;
  fx: number;
  fy: number;
  cx: number;
  cy: number;
  z0_m: number;
  depth_step: number;
  reference: string;
}

/** What only a bench's section has. */
interface BenchTables {
  board: Leaderboard;
  losses: Array<SideLosses>;
  tiers: Array<TierBar>;
  outcomes: Array<Outcome>;
  errors: Array<Outcome>;
  delta: number;
  tolerance: number;
  noise_floor: string;
}

/** A case in the list, with what it can be filtered by. tier: "" where it has none. */
interface CaseLine {
  id: number;
  file_name: string;
  view: number;
  n_truth: number;
  cells: Array<PhotoCell>;
  categories: Array<number>;
  family: string;
  tier: string;
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

/** A validity check, as the readout recorded it. */
interface CheckLine {
  name: string;
  ok: boolean;
  found: string;
  expected: string;
  next_step: string;
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

/** What computed the official numbers. */
interface Evaluator {
  name: string;
  version: string;
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

/** The percentile interval of bootstrap samples; low and high are None when none is defined. */
interface Interval {
  low: number | null;
  high: number | null;
  level: number;
  unit: string;
  draws: number;
  undefined_draws: number;
  bootstrap_mean: number | null;
}

/** IoU of predictions with the ground truth of their category that they are about. */
interface IouHistogram {
  label: string;
  edges: Array<number>;
  tp: Array<number>;
  low: Array<number>;
}

/** Rows by falling S over all attempted; evidence_sha256: of each evaluation, by its name. */
interface Leaderboard {
  schema_version: number;
  task: string;
  evaluator: Evaluator;
  draws: number;
  seed: number;
  rows: Array<LeaderboardRow>;
  evidence_sha256: Record<string, string>;
}

/** Cases of one kind of group (all, split, environment, theme or tier) and its name. */
interface LeaderboardGroup {
  kind: string;
  name: string;
  cases: number;
  metrics: Record<string, Repeated>;
}

/** One agent and model. evaluations: names of the folders of its runs. */
interface LeaderboardRow {
  agent: string;
  model: string;
  evaluations: Array<string>;
  groups: Array<LeaderboardGroup>;
}

/** Objects of a category and what they cost R. lost: of R's mean over all attempted cases. */
interface Loss {
  category: number;
  name: string;
  objects: number;
  mean_f1: number;
  lost: number;
}

/** One side's object. at: F at the other tolerances, by name; eligible: whether R counts it. */
interface ObjectScore {
  f1: number;
  precision: number;
  recall: number;
  eligible: boolean;
  n_reference: number;
  n_submitted: number;
  at: Record<string, number>;
}

/** A colour of a picture and what it stands for. colour: #rrggbb. */
interface Outcome {
  name: string;
  text: string;
  colour: string;
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
  bench: BenchTables | null;
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

/** A metric over repeated runs: their mean, and standard deviation with ddof = 1. */
interface Repeated {
  mean: number | null;
  sd: number | null;
  runs: Array<number | null>;
  n: Array<number>;
  over: "attempted" | "valid";
  interval: Interval | null;
}

/** What costs a side most, the most first. n: all its errors. */
interface SideCosts {
  label: string;
  n: number;
  most: Array<Cost>;
}

/** One side. scored: images; used_truth: whether its prompts came from the truth. */
interface SideHead {
  label: string;
  scored: number;
  scene: boolean;
  used_truth: boolean;
}

/** What costs a side's R most. lost: all that is missing to 1; not_valid: by V = 0. */
interface SideLosses {
  label: string;
  lost: number;
  not_valid: number;
  most: Array<Loss>;
}

/** A number and the ends of its interval, None where it has none. over: its denominators. */
interface Span {
  value: number | null;
  low: number | null;
  high: number | null;
  over: string;
}

/** One agent's metric by tier. values, sds: in the order of `tiers`; None where undefined. */
interface TierBar {
  label: string;
  metric: string;
  tiers: Array<string>;
  cases: Array<number>;
  values: Array<number | null>;
  sds: Array<number | null>;
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
