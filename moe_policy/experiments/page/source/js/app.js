// The page: tabs, one stage for each problem, whose data are loaded when it is first opened.

import { Model } from "./model.js";
import { Stage } from "./stage.js";
import { themed } from "./theme.js";
import { PENDULUM } from "./views/pendulum.js";
import { SPHERE } from "./views/sphere.js";
import { VEHICLE } from "./views/vehicle.js";

/** The views whose data are built. */
const BUILT = document.documentElement.dataset.problems.split(" ");
const VIEWS = [PENDULUM, VEHICLE, SPHERE].filter(({ file }) => BUILT.includes(file)), stages = new Map(), arrived = new Map();
const tabs = document.getElementById("tabs"), status = document.getElementById("status");

/** Called by the files of data, which are scripts, since pages that are opened as files may load nothing else. */
window.receive = (name, description) => arrived.get(name)(description);

function loaded(name) {
  return new Promise((resolve, reject) => {
    arrived.set(name, resolve);
    const script = Object.assign(document.createElement("script"), { src: `${name}.js`, onerror: reject });
    document.head.append(script);
  });
}

async function stageOf(view) {
  const model = await Model.of(await loaded(view.file));
  const root = document.getElementById("stage").content.firstElementChild.cloneNode(true);
  document.querySelector("main").append(root);
  return new Stage(root, model, view);
}

/** Show the problem of a view, and hide the others. */
async function open(view) {
  for (const tab of tabs.children) {
    if (tab.dataset.file === view.file) tab.setAttribute("aria-current", "page");
    else tab.removeAttribute("aria-current");
  }
  status.textContent = stages.has(view.file) ? "" : `Loading ${view.title.toLowerCase()} …`;
  if (!stages.has(view.file)) stages.set(view.file, stageOf(view));
  try {
    await stages.get(view.file);
    status.textContent = "";
  } catch {
    status.textContent = `The file ${view.file}.js, which belongs to this page, cannot be loaded.`;
  }
  for (const [file, promise] of stages) promise.then((stage) => {
    stage.root.hidden = file !== view.file;
    if (!stage.root.hidden) stage.paint();
    else stage.player.toggle(false);
  });
}

for (const view of VIEWS) {
  const tab = Object.assign(document.createElement("button"), { type: "button", textContent: view.title });
  tab.dataset.file = view.file;
  tab.addEventListener("click", () => open(view));
  tabs.append(tab);
}
tabs.hidden = VIEWS.length < 2;
themed(document.getElementById("theme"), () => {
  for (const promise of stages.values()) promise.then((stage) => stage.paint());
});
open(VIEWS.find(({ file }) => location.hash === `#${file}`) ?? VIEWS[0]);

/** The stage of a problem, for programs that drive the page. */
window.stageOf = (file) => stages.get(file);
