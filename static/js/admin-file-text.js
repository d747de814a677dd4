// A form with a text that may lie in a file: a chosen file's text is put into the field, where it can be changed.

for (const input of document.querySelectorAll("input[type=file][data-into]")) {
  if (!(input instanceof HTMLInputElement)) continue;
  input.addEventListener("change", async () => {
    const field = input.form?.elements.namedItem(input.dataset.into ?? "");
    const file = input.files?.[0];
    if (field instanceof HTMLTextAreaElement && file) field.value = await file.text();
  });
}
