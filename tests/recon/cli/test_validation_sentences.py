from __future__ import annotations

from recon.cli.validation_sentences import view_sentences


def test_beside_what_a_model_covers_stands_how_like_the_photographs_the_whole_object_is() -> None:
    shares = {"ssim": 0.81, "coverage": 0.9, "spill": 0.02, "back_faces": 0.123}
    row = {"kind": "held out", "region": "all", "approach": "dr_fb", "psnr_db": 24.5, "psnr_object_db": 20.7} | shares
    report = {"settings": {"threshold_mm": 2.0}, "agreement": [], "means": [row, row | {"region": "rim"}]}
    (sentence,) = view_sentences(report)
    assert sentence.startswith("held out, dr_fb: PSNR 24.50, PSNR of the object 20.70, SSIM 0.810")
    assert sentence.endswith("spill 2.0%, back faces 12.3%")
