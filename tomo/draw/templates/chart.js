// The charts below a film: a line at the frame that it shows, its figures, and clicks that choose it.

const film = stages[0], cursors = [...document.querySelectorAll(".cursor")];
const figures = [...document.querySelectorAll("output[data-values]")]
  .map((one) => [one, one.dataset.values.split("|")]);

function mark(k) {
  for (const cursor of cursors) cursor.style.left = `${100 * film.data.moments[k].at}%`;
  for (const [output, values] of figures) output.textContent = values[k];
}

film.root.addEventListener("moment", (event) => mark(event.detail));
for (const area of document.querySelectorAll(".plot .area"))
  area.addEventListener("click", (event) => {
    const box = area.getBoundingClientRect(), at = (event.clientX - box.left) / box.width;
    const apart = film.data.moments.map((moment) => Math.abs(moment.at - at));
    if (!film.moment) return;
    film.pause();
    film.moment(apart.indexOf(Math.min(...apart)));
  });
mark(0);
