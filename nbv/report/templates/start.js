// Start: each view comes to life when it comes near the window.

// Draw a figure's model in place of its pictures; they stay where it cannot be drawn.
async function bringToLife(figure) {
  try {
    const model = await decoded(figure.querySelector(".view-data").textContent);
    figure.view = new View(figure, model);
  } catch (error) {
    figure.classList.add("has-failed");
    console.info(`The 3-D view cannot be drawn here: ${error.message}`);
  }
}

if (window.WebGL2RenderingContext && window.DecompressionStream) {
  const near = new IntersectionObserver(entries => entries.filter(one => one.isIntersecting).forEach(({ target }) => {
    near.unobserve(target);
    bringToLife(target);
  }), { rootMargin: "600px" });
  document.querySelectorAll("figure.view").forEach(figure => near.observe(figure));
}
