#!/usr/bin/env bash
# xarray 2026.9.0: packed values outside valid_range are values like any other; netCDF4 1.7 masks them.
#
# Expected: CF conventions, section 2.5.1 (and the NetCDF Users Guide, Appendix A, valid_range): values outside of
#   valid_range, which is stated in packed values, are to be treated as missing. xarray decodes CF: _FillValue,
#   missing_value, scale_factor and add_offset are applied, and taken out of the attributes.
# Seen: of packed 0, 1, 2, 250, 255 with valid_range 0 to 200, netCDF4-python masks 250 and 255, xarray only the fill
#   value 255. 250 becomes 125, and the mean 31.6 instead of 0.5. What xarray leaves as the attribute, 0 to 200,
#   can not be compared any more with the values, which are unpacked.
# Why it matters: MINC and NetCDF volumes may mark so what was not measured; it then counts in means and thresholds.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install -q --disable-pip-version-check xarray==2026.9.0 netCDF4==1.7.5.1.post1 numpy==2.4.6
cd "$work"
venv/bin/python - <<'EOF'
import sys
import netCDF4, numpy as np, xarray

packed = np.array([0, 1, 2, 250, 255], np.uint8)
with netCDF4.Dataset("packed.nc", "w") as file:
    file.createDimension("x", packed.size)
    variable = file.createVariable("ct", "u1", ("x",), fill_value=255)
    variable.set_auto_maskandscale(False)
    variable.scale_factor, variable.valid_range = 0.5, np.array([0, 200], np.uint8)
    variable[:] = packed
with netCDF4.Dataset("packed.nc") as file:
    masked = file["ct"][:]
read = xarray.open_dataset("packed.nc").ct
print("packed ", packed.tolist(), "valid 0 to 200, scale 0.5, fill 255")
print("netCDF4", masked.tolist(), "mean", float(masked.mean()))
print("xarray ", read.values.tolist(), "mean", float(read.mean()), "valid_range", read.attrs["valid_range"].tolist())
if float(masked.mean()) != 0.5 or float(read.mean()) != 31.625:
    sys.exit("changed: no longer as recorded above")
EOF
