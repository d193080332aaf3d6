//! Run lengths in byte planes (DICOM PS3.5, annex G).

/// Unpacks a frame: a table of up to 15 segments, one for each byte of a pixel, most significant
/// first, each packed as PackBits packs. Pixels come out least significant byte first.
///
/// # Errors
/// What is wrong, as text for a message.
pub(crate) fn decode(packed: &[u8], bytes: usize, out: &mut [u8]) -> Result<(), String> {
    let word = |i: usize| {
        let four = packed.get(4 * i..4 * i + 4)?;
        Some(u32::from_le_bytes([four[0], four[1], four[2], four[3]]) as usize)
    };
    let short = || "a table of segments that is cut short".to_owned();
    let segments = word(0).ok_or_else(short)?;
    if segments != bytes {
        return Err(format!("{segments} segments for {bytes} bytes per pixel"));
    }
    for plane in 0..bytes {
        let start = word(1 + plane).ok_or_else(short)?;
        let end = match plane + 1 < bytes {
            true => word(2 + plane).ok_or_else(short)?,
            false => packed.len(),
        };
        let segment = packed
            .get(start..end.min(packed.len()))
            .filter(|_| start >= 64)
            .ok_or_else(|| format!("a segment from {start} to {end}"))?;
        plane_of(segment, out, bytes - 1 - plane, bytes)?;
    }
    Ok(())
}

/// Unpacks a segment to every `step`th byte from `first` on.
fn plane_of(packed: &[u8], out: &mut [u8], first: usize, step: usize) -> Result<(), String> {
    let mut places = out.iter_mut().skip(first).step_by(step);
    let mut left = places.len();
    let mut bytes = packed.iter();
    let cut = || "a segment that is cut short".to_owned();
    while left > 0 {
        let n = *bytes.next().ok_or_else(cut)? as i8;
        if n == -128 {
            continue;
        }
        let run = n < 0;
        let count = (n.unsigned_abs() as usize + 1).min(left);
        let mut byte = 0;
        for i in 0..count {
            if i == 0 || !run {
                byte = *bytes.next().ok_or_else(cut)?;
            }
            if let Some(place) = places.next() {
                *place = byte;
            }
        }
        left -= count;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_are_put_together() {
        let mut packed = vec![0; 64];
        packed[0] = 2;
        packed[4] = 64;
        packed[8] = 66;
        // high bytes: a run of four 1; low bytes: 5 6 as they are, then twice 7
        packed.extend([253, 1, 1, 5, 6, 255, 7]);
        let mut out = [0; 8];
        decode(&packed, 2, &mut out).unwrap();
        assert_eq!(out, [5, 1, 6, 1, 7, 1, 7, 1]);
        for len in 0..packed.len() {
            assert!(decode(&packed[..len], 2, &mut out).is_err(), "{len}");
        }
        assert!(decode(&packed, 1, &mut out).is_err());
    }
}
