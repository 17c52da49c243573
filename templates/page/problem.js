// What goes wrong is told where a reader looks, and not in the console alone.
"use strict";
function tellProblem(problem) {
  document.getElementById("problem").textContent += "This page could not be shown in full: " + problem + "\n";
  document.body.dataset.state = "failed";
}
window.addEventListener("error", (event) => tellProblem(event.message));
window.addEventListener("unhandledrejection", (event) => tellProblem(event.reason));
