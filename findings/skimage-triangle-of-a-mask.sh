#!/usr/bin/env bash
# scikit-image 0.26.0: threshold_triangle of a mask of 0 and 1 leaves nothing above it if the ones are the minority.
#
# Expected: the documentation of every threshold_* function says that values above the threshold are the foreground, so
#   a mask comes out as it went in, as it does with threshold_otsu and threshold_li.
# Seen: the line from the peak (0) to the end of the tail (1) has no level between its ends, and the method returns the
#   far end itself: 1. `mask > 1` is empty. With the ones as the majority the peak is 1, the result is 0, and the mask
#   comes out whole. The same scene stored as 0 and 255 has levels between and gives 1: right again.
# Why it matters: pipelines try several methods on whatever comes, masks included; a sample without material has a
#   porosity of 100 %, and nothing is raised.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install -q --disable-pip-version-check scikit-image==0.26.0 numpy==2.4.6
cd "$work"
venv/bin/python - <<'EOF'
import sys
import numpy as np
from skimage.filters import threshold_li, threshold_otsu, threshold_triangle

few = (np.random.default_rng(0).random((30, 30, 30)) < 0.1).astype(np.uint8)
cases = {"few ones": few, "many ones": 1 - few, "few of 255": 255 * few}
shares = {}
for name, image in cases.items():
    for function in (threshold_otsu, threshold_li, threshold_triangle):
        threshold = float(function(image.copy()))
        share = float((image > threshold).mean())
        shares[name, function.__name__] = share
        print(f"{name:11} {function.__name__:18} {threshold:8.4f}: {100 * share:5.1f} % above, "
              f"{100 * (image > 0).mean():5.1f} % are not 0")
true = {name: float((image > 0).mean()) for name, image in cases.items()}
others = all(shares[name, f"threshold_{m}"] == true[name] for name in cases for m in ("otsu", "li"))
if not (others and shares["few ones", "threshold_triangle"] == 0
        and shares["many ones", "threshold_triangle"] == true["many ones"]
        and shares["few of 255", "threshold_triangle"] == true["few of 255"]):
    sys.exit("changed: no longer as recorded above")
EOF
