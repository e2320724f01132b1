// The first script: unpacks all others, which the page holds compressed, and starts them.

/** The bytes of compressed ones that an element holds as text. */
async function inflated(id) {
  const text = document.getElementById(id).textContent.trim();
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Response(stream).arrayBuffer();
}

inflated("texts").then((buffer) => {
  window.texts = JSON.parse(new TextDecoder().decode(buffer));
  const script = document.createElement("script");
  script.type = "module";
  script.textContent = window.texts.script;
  document.body.append(script);
}).catch(() => {
  const trouble = "This browser cannot unpack the page, as those from 2023 on do.";
  document.getElementById("trouble").textContent = trouble;
  document.body.dataset.ready = "no";
});
