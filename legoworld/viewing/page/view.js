// What is below the folder now, asked for again and again; a source's section is made anew only
// when something of it has changed, so that scrolling and focus stay.
const EVERY_MS = 1500;
const main = document.getElementById("sources");
const said = document.getElementById("said");
const shown = new Map();

function element(name, texts = {}, children = []) {
  const made = Object.assign(document.createElement(name), texts);
  made.append(...children);
  return made;
}

const address = (kind, name) => `${kind}/${name.split("/").map(encodeURIComponent).join("/")}`;

function counts(source) {
  const of = source.of === null ? "" : ` of ${source.of}`;
  const verb = source.kind === "evaluation" ? "scored" : "done";
  const done = source.kind === "comparison" ? [] : [`${source.done}${of} ${verb}`];
  return [source.result, ...done, ...Object.entries(source.statuses).map(([name, n]) => `${n} ${name}`)].filter(Boolean).join(" · ");
}

function picture(row) {
  const image = element("img", { src: address("picture", row.picture), alt: `last picture of ${row.name}` });
  return element("li", {}, [image, element("b", { textContent: row.name }), ` ${row.status} ${row.note}`]);
}

function table(rows) {
  const head = element("tr", {}, ["name", "status", "reason"].map(text => element("th", { textContent: text, scope: "col" })));
  const body = rows.map(row => element("tr", {}, [row.name, row.status, row.note].map(text => element("td", { textContent: text }))));
  const made = element("table", {}, [element("thead", {}, [head]), element("tbody", {}, body)]);
  return element("div", { className: "scroll", tabIndex: 0 }, [made]);
}

function section(source) {
  const words = [source.kind, source.task, source.finished ? "" : "not finished"].filter(Boolean).join(", ");
  const top = [element("h2", { textContent: source.name === "." ? "this folder" : source.name }), element("span", { className: "soft", textContent: words })];
  if (!source.finished && source.of) {
    const bar = element("progress", { value: source.done, max: source.of });
    bar.setAttribute("aria-label", `done of ${source.name}`);
    top.push(bar);
  }
  top.push(element("span", { className: "soft", textContent: counts(source) }));
  if (source.page) top.push(element("a", { href: address("report", source.name), target: "_blank", textContent: "open its page" }));
  const made = element("section", { className: source.rows.length ? "" : "line" }, [element("div", {}, top)]);
  if (source.problem) made.append(element("p", { className: "problem", textContent: source.problem }));
  const pictures = source.rows.filter(row => row.picture);
  const others = source.rows.filter(row => !row.picture);
  if (pictures.length) made.append(element("ul", { className: "pictures" }, pictures.map(picture)));
  if (others.length) made.append(table(others));
  return made;
}

function show(state) {
  const names = new Set(state.sources.map(source => source.name));
  for (const [name, one] of shown) if (!names.has(name)) { one.section.remove(); shown.delete(name); }
  let before = null;
  const order = [...state.sources].sort((one, two) => one.finished - two.finished);
  for (const source of order) {
    const text = JSON.stringify(source);
    let one = shown.get(source.name);
    if (one?.text !== text) {
      const made = section(source);
      one?.section.replaceWith(made);
      one = { text, section: made };
      shown.set(source.name, one);
    }
    const next = before ? before.nextElementSibling : main.firstElementChild;
    if (next !== one.section) main.insertBefore(one.section, next);
    before = one.section;
  }
  const going = state.sources.filter(source => !source.finished).length;
  const what = state.sources.length ? `${going} of ${state.sources.length} not finished` : "no run, trial or evaluation yet";
  say(`${state.folder}: ${what}${state.left_out ? "; it holds more folders than are looked into" : ""}`, false);
}

function say(text, lost) {
  if (said.textContent !== text) said.textContent = text;
  said.classList.toggle("lost", lost);
}

let tag = "";
async function look() {
  try {
    const answer = await fetch("state.json", { headers: tag ? { "If-None-Match": tag } : {} });
    if (answer.status === 200) {
      tag = answer.headers.get("ETag");
      show(await answer.json());
    } else if (answer.status !== 304) {
      say(`the server answers ${answer.status}`, true);
    }
  } catch {
    tag = "";
    say("legoworld view has ended; start it again and open its new address", true);
  }
  setTimeout(look, EVERY_MS);
}
look();
