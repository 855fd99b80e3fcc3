// Steps through the views of a report: three images and a line of words each.

const compared = document.getElementById("compared");
const entries = JSON.parse(compared.querySelector("script").textContent);
const [slider, words] = ["input", "output"].map((name) => compared.querySelector(name));

function compare(k) {
  slider.value = k;
  words.textContent = entries[k].words;
  compared.querySelectorAll("img").forEach((image, one) => { image.src = entries[k].images[one]; });
}

slider.addEventListener("input", () => compare(Number(slider.value)));
compared.querySelectorAll("button").forEach((button, side) => button.addEventListener("click", () =>
  compare((Number(slider.value) + (side ? 1 : -1) + entries.length) % entries.length)));
