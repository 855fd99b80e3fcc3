// The page beside a program: asks it for frames, camera images and comparisons as they are shown.

const live = JSON.parse(document.getElementById("live").textContent), stage = stages[0];
const told = document.getElementById("told"), waiting = {};
let shownAt = 0;

// What the program answers; null where something newer of its kind was asked for since.
async function ask(kind, path, how) {
  if (waiting[kind]) waiting[kind].abort();
  const own = waiting[kind] = new AbortController();
  try {
    const answer = await fetch(path, { signal: own.signal });
    if (!answer.ok) throw new Error(await answer.text());
    const found = await answer[how]();
    if (waiting[kind] !== own) return null;
    told.textContent = "";
    return found;
  } catch (error) {
    if (error.name === "AbortError") return null;
    told.textContent = error instanceof TypeError ? "The program that served this page has ended."
      : `Not shown: ${error.message}`;
    return null;
  }
}

async function showVolume(k) {
  const bytes = stage.data.volume && await ask("volume", `volume/${k}`, "arrayBuffer");
  if (bytes && stage.light) stage.light.hold(new Uint8Array(bytes));
}

async function showImages(k) {
  const batch = stage.light && stage.light.batches.find(({ mesh }) => mesh.group === "images");
  const bytes = batch && await ask("images", `images/${k}`, "arrayBuffer");
  if (bytes) stage.light.recolour(batch, new Uint8Array(bytes));
}

stage.load = async (k) => {
  shownAt = k;
  await Promise.all([showVolume(k), showImages(k)]);
  stage.ask();
  if (live.cameras.length) compare(Number(chooser.value));
};

if (live.cameras.length) {
  compare = async (camera) => {
    compared.setAttribute("aria-busy", "true");
    const entry = await ask("compare", `compare/${shownAt}/${camera}`, "json");
    if (entry) {
      present(entry);
      compared.setAttribute("aria-busy", "false");
    }
  };
  const named = () => live.cameras.indexOf(decodeURIComponent(location.hash.slice(1)));
  choose(named() >= 0 ? named() : Number(chooser.value));
  addEventListener("hashchange", () => { if (named() >= 0) choose(named()); });
  stage.listeners.push((under) => {
    const camera = under ? live.cameras.indexOf(under.name) : -1;
    if (camera >= 0) choose(camera);
  });
}
