// Sliders and buttons: every input of the page that has a name is a number or a choice.

const inputs = () => [...document.querySelectorAll("input[name]")];

// Of a model that lacks a part there is no slider for it.
const WITHOUT_SLIDERS = {
  diffuse: 1, specular: 1, residual: 1, depth: 1, diffuse_width: 0, specular_width: 0,
};

/** The state that the inputs show: numbers, and the shape that is chosen. */
function readControls() {
  const state = { ...WITHOUT_SLIDERS };
  for (const input of inputs()) {
    if (input.type === "range") state[input.name] = Number(input.value);
    else if (input.checked) state[input.name] = input.value;
  }
  return state;
}

const WORDS = {
  degrees: (value) => `${Math.round(value)}°`,
  percent: (value) => `${Math.round(100 * value)} %`,
  factor: (value) => `${(2 ** value).toFixed(2)} ×`,
  times: (value) => `${value.toFixed(2)} ×`,
  stops: (value) => `${value > 0 ? "+" : ""}${value.toFixed(1)} EV`,
  copies: (value) => `${value}`,
};

function showValues() {
  for (const input of inputs().filter((each) => each.type === "range")) {
    const output = document.querySelector(`output[for="${input.id}"]`);
    output.textContent = WORDS[input.dataset.unit](Number(input.value));
    const part = (input.value - input.min) / (input.max - input.min);
    input.style.setProperty("--part", `${100 * part}%`);
  }
}

function setControl(name, value) {
  const input = document.querySelector(`input[name="${name}"]`);
  input.value = value;
  showValues();
}

/** Calls changed() after every input, and puts all of them back where the button says so. */
function followControls(changed) {
  const update = () => { showValues(); changed(); };
  inputs().forEach((input) => input.addEventListener("input", update));
  // A button of the name "reset" would hide the method of the form.
  document.getElementById("start_again").addEventListener("click", () => {
    document.getElementById("controls").reset();
    changed(true);
    showValues();
  });
  showValues();
}
