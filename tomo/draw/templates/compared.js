// Steps through the views of a report: three images and a line of words each.

const compared = document.getElementById("compared");
const entries = JSON.parse(compared.querySelector("script").textContent);
const [chooser, words] = ["input", "output"].map((name) => compared.querySelector(name));

function present(entry) {
  words.textContent = entry.words;
  compared.querySelectorAll("img").forEach((image, one) => {
    image.parentNode.hidden = !entry.images[one];
    if (entry.images[one]) image.src = entry.images[one];
  });
}

// A page beside a program asks it for an entry instead.
let compare = (k) => present(entries[k]);

function choose(k) {
  chooser.value = k;
  compare(Number(k));
}

chooser.addEventListener("input", () => choose(chooser.value));
compared.querySelectorAll("button").forEach((button, side) => button.addEventListener("click", () =>
  choose((Number(chooser.value) + (side ? 1 : -1) + entries.length) % entries.length)));
