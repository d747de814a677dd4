/** On a page that asks for the code to go on: fills in the one that this browser has kept. */

import { required } from "./elements.js";
import { Begun } from "./known-again.js";

const form = required(HTMLFormElement, "form[data-person]");
required(HTMLInputElement, "[name=resume_code]", form).value = new Begun(form.dataset.person ?? "").resumeCode;
