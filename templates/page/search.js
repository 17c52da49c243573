// Charts by Chart.js, of numbers that the page holds, and sliders between two pictures.
"use strict";
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  // Okabe and Ito's colours, which people with any colour vision tell apart.
  const colors = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000"];
  const axis = (text) => ({ title: { display: true, text } });
  Chart.defaults.animation = false;
  Chart.defaults.maintainAspectRatio = false;
  Chart.defaults.font.family = getComputedStyle(document.body).fontFamily;

  new Chart(document.getElementById("course"), {
    type: "line",
    data: {
      labels: data.generations,
      datasets: data.lines.map((line, k) => ({
        label: line.name,
        data: line.values,
        spanGaps: true,
        borderColor: colors[k % colors.length],
        backgroundColor: colors[k % colors.length],
        borderDash: k < colors.length ? [] : [6, 3],
        borderWidth: 1.8,
        pointRadius: line.values.length > 60 ? 0 : 2.5,
      })),
    },
    options: {
      interaction: { mode: "index", intersect: false },
      scales: { x: axis("generation"), y: axis(data.axis) },
    },
  });

  if (data.front) {
    const open = (k) => {
      const details = document.getElementById("program-" + k);
      details.open = true;
      details.scrollIntoView({ block: "center" });
    };
    const points = data.front.programs.map((program, k) => ({ x: program.place[0], y: program.place[1], k }));
    const sets = [
      { label: "the front", points: points.filter((p) => !data.front.programs[p.k].result), pointStyle: "circle" },
      { label: "the result", points: points.filter((p) => data.front.programs[p.k].result), pointStyle: "rectRot" },
    ];
    new Chart(document.getElementById("front"), {
      type: "scatter",
      data: {
        datasets: sets.map((set, k) => ({
          label: set.label,
          data: set.points,
          backgroundColor: colors[k],
          pointStyle: set.pointStyle,
          pointRadius: 6 + 2 * k,
          pointHoverRadius: 9,
        })),
      },
      options: {
        scales: {
          x: { type: "logarithmic", ...axis(data.front.x) },
          y: { type: "logarithmic", ...axis(data.front.y) },
        },
        onClick: (_, found) => {
          if (found.length) open(sets[found[0].datasetIndex].points[found[0].index].k);
        },
        onHover: (event, found) => {
          event.native.target.style.cursor = found.length ? "pointer" : "default";
        },
        plugins: {
          legend: { labels: { usePointStyle: true } },
          tooltip: {
            callbacks: {
              label: (item) => `${data.front.programs[item.raw.k].name}: ${item.formattedValue}`,
            },
          },
        },
      },
    });
  }

  for (const slide of document.querySelectorAll(".slide + input")) {
    slide.addEventListener("input", () => {
      slide.previousElementSibling.style.setProperty("--at", slide.value + "%");
    });
  }
  document.body.dataset.state = "ready";
})();
