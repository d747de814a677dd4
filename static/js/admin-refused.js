// Gives a page on which a refused form is shown again its own address back: at the form's there is no page to come from
// when the form is refused once more, nor to load again.

if (document.getElementById("refused")) history.replaceState(null, "", document.referrer);
