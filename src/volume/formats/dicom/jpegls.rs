//! JPEG-LS, lossless and near-lossless, of one component.
//!
//! ITU-T T.87 (<https://www.itu.int/rec/T-REC-T.87>): names of variables are those of its annex A.

/// Orders of run lengths (table A.7 of T.87).
const J: [u32; 32] = [
    0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3, 4, 4, 5, 5, 6, 6, 7, 7, 8, 9, 10, 11, 12, 13,
    14, 15,
];
/// Contexts of gradients; two for the ends of runs follow them.
const CONTEXTS: usize = 365;

/// Unpacks a frame to pixels of `bytes` bytes, least significant first.
///
/// # Errors
/// What is wrong, as text for a message.
pub(crate) fn decode(
    packed: &[u8],
    size: [u32; 2],
    bytes: usize,
    out: &mut [u8],
) -> Result<(), String> {
    let (frame, scan) = Frame::read(packed)?;
    if frame.size != size || frame.bits as usize > 8 * bytes {
        let [x, y] = frame.size;
        return Err(format!(
            "JPEG-LS of {x} x {y} pixels of {} bits",
            frame.bits
        ));
    }
    let mut decoder = Decoder::new(&frame, scan)?;
    let width = size[0] as usize;
    // one more pixel on each side, as the edges ask for
    let (mut above, mut line) = (vec![0i32; width + 2], vec![0i32; width + 2]);
    for row in out.chunks_exact_mut(width * bytes) {
        line[0] = above[1];
        above[width + 1] = above[width];
        decoder.line(&above, &mut line)?;
        for (out, v) in row.chunks_exact_mut(bytes).zip(&line[1..]) {
            out.copy_from_slice(&v.to_le_bytes()[..bytes]);
        }
        std::mem::swap(&mut above, &mut line);
    }
    Ok(())
}

/// What the markers say.
#[derive(Debug)]
struct Frame {
    size: [u32; 2],
    bits: u32,
    near: i32,
    /// MAXVAL, T1, T2, T3 and RESET; 0 for the default.
    preset: [i32; 5],
}

impl Frame {
    /// Reads the markers up to the scan, which is returned with them.
    fn read(packed: &[u8]) -> Result<(Frame, &[u8]), String> {
        let mut rest = packed
            .strip_prefix(&[0xff, 0xd8])
            .ok_or("JPEG-LS without a beginning")?;
        let mut frame = None;
        let mut preset = [0; 5];
        loop {
            let cut = || "JPEG-LS markers that are cut short".to_owned();
            let [0xff, marker, high, low, ..] = *rest else {
                return Err(cut());
            };
            let len = usize::from(u16::from_be_bytes([high, low]));
            let body = rest.get(4..2 + len).ok_or_else(cut)?;
            rest = &rest[2 + len..];
            let word = |at: usize| {
                let pair = body.get(at..at + 2).ok_or_else(cut)?;
                Ok::<_, String>(u32::from(u16::from_be_bytes([pair[0], pair[1]])))
            };
            match (marker, body) {
                (0xf7, [bits @ 2..=16, .., _, _, _]) if body.len() == 9 && body[5] == 1 => {
                    frame = Some(([word(3)?, word(1)?], u32::from(*bits)));
                }
                (0xf7, _) => return Err("JPEG-LS of several components".into()),
                (0xf8, [1, ..]) => {
                    for (i, value) in preset.iter_mut().enumerate() {
                        *value = word(1 + 2 * i)? as i32;
                    }
                }
                (0xda, [1, _, _, near, 0, _]) => {
                    let (size, bits) = frame.ok_or("JPEG-LS without a size")?;
                    let near = i32::from(*near);
                    let frame = Frame {
                        size,
                        bits,
                        near,
                        preset,
                    };
                    return Ok((frame, rest));
                }
                (0xe0..=0xef | 0xfe, _) => {}
                _ => return Err(format!("the JPEG-LS marker {marker:02x}")),
            }
        }
    }

    /// MAXVAL, the three thresholds and RESET (T.87, C.2.4.1.1).
    fn parameters(&self) -> Result<[i32; 5], String> {
        let near = self.near;
        let given = |i: usize, default: i32| match self.preset[i] {
            0 => default,
            n => n,
        };
        let max = given(0, (1 << self.bits) - 1);
        let clamp = |v: i32, low: i32| if v > max || v < low { low } else { v };
        let [t1, t2, t3] = if max >= 128 {
            let factor = (max.min(4095) + 128) / 256;
            [factor + 2, factor * 4 + 3, factor * 17 + 4]
        } else {
            let factor = 256 / (max + 1);
            [3, 7, 21].map(|t| t / factor)
        };
        let least = |v: i32, low: i32| if max >= 128 { v } else { v.max(low) };
        let t1 = given(1, clamp(least(t1 + 3 * near, 2), near + 1));
        let t2 = given(2, clamp(least(t2 + 5 * near, 3), t1));
        let t3 = given(3, clamp(least(t3 + 7 * near, 4), t2));
        let reset = given(4, 64);
        let ranges = (1..1 << self.bits).contains(&max) && near <= max / 2 && reset >= 3;
        let rising = near < t1 && t1 <= t2 && t2 <= t3 && t3 <= max;
        if !ranges || !rising {
            return Err(format!(
                "the JPEG-LS parameters {max}, {t1}, {t2}, {t3}, {reset}"
            ));
        }
        Ok([max, t1, t2, t3, reset])
    }
}

/// Bits of a scan: after a byte of ones, the next byte has 7.
struct Bits<'a> {
    bytes: &'a [u8],
    word: u32,
    left: u32,
    stuffed: bool,
}

impl Bits<'_> {
    fn one(&mut self) -> Result<u32, String> {
        if self.left == 0 {
            let (&byte, rest) = self.bytes.split_first().ok_or("a scan that is cut short")?;
            if self.stuffed && byte & 0x80 != 0 {
                return Err("a JPEG-LS scan that is cut short".into());
            }
            (self.word, self.left) = (u32::from(byte), if self.stuffed { 7 } else { 8 });
            (self.stuffed, self.bytes) = (byte == 0xff, rest);
        }
        self.left -= 1;
        Ok(self.word >> self.left & 1)
    }

    fn many(&mut self, count: u32) -> Result<i32, String> {
        let mut out = 0;
        for _ in 0..count {
            out = out << 1 | self.one()?;
        }
        Ok(out as i32)
    }

    /// A number of Golomb's code with at most `limit` bits (A.5.3).
    fn golomb(&mut self, k: u32, limit: u32, qbpp: u32) -> Result<i32, String> {
        let most = limit.saturating_sub(qbpp + 1);
        let mut zeros = 0;
        while self.one()? == 0 {
            zeros += 1;
            if zeros > most {
                return Err("a JPEG-LS scan that is damaged".into());
            }
        }
        if zeros < most {
            Ok((zeros as i32) << k | self.many(k)?)
        } else {
            Ok(self.many(qbpp)? + 1)
        }
    }
}

/// The statistics of a context.
#[derive(Debug, Clone, Copy)]
struct Context {
    a: i32,
    b: i32,
    c: i32,
    n: i32,
}

struct Decoder<'a> {
    bits: Bits<'a>,
    contexts: Vec<Context>,
    /// Negative errors at the ends of runs, for both kinds.
    negative: [i32; 2],
    run_index: usize,
    max: i32,
    near: i32,
    thresholds: [i32; 3],
    reset: i32,
    range: i32,
    qbpp: u32,
    limit: u32,
}

fn log2(n: i32) -> u32 {
    32 - (n - 1).leading_zeros()
}

impl<'a> Decoder<'a> {
    fn new(frame: &Frame, scan: &'a [u8]) -> Result<Self, String> {
        let [max, t1, t2, t3, reset] = frame.parameters()?;
        let near = frame.near;
        let range = (max + 2 * near) / (2 * near + 1) + 1;
        let bpp = log2(max + 1).max(2);
        let first = Context {
            a: ((range + 32) / 64).max(2),
            b: 0,
            c: 0,
            n: 1,
        };
        Ok(Decoder {
            bits: Bits {
                bytes: scan,
                word: 0,
                left: 0,
                stuffed: false,
            },
            contexts: vec![first; CONTEXTS + 2],
            negative: [0; 2],
            run_index: 0,
            max,
            near,
            thresholds: [t1, t2, t3],
            reset,
            range,
            qbpp: log2(range),
            limit: 2 * (bpp + bpp.max(8)),
        })
    }

    /// Decodes a line; pixel x is at x + 1.
    fn line(&mut self, above: &[i32], line: &mut [i32]) -> Result<(), String> {
        let end = line.len() - 1;
        let mut x = 1;
        while x < end {
            let (a, b, c, d) = (line[x - 1], above[x], above[x - 1], above[x + 1]);
            let gradients = [d - b, b - c, c - a];
            if gradients.iter().any(|g| g.abs() > self.near) {
                line[x] = self.regular([a, b, c], gradients)?;
                x += 1;
                continue;
            }
            let start = x;
            let ended = self.run(end - x, &mut x)?;
            line[start..x].fill(a);
            if !ended {
                line[x] = self.end_of_run(a, above[x])?;
                self.run_index = self.run_index.saturating_sub(1);
                x += 1;
            }
        }
        Ok(())
    }

    /// Moves `x` by the length of a run; true if the line ends with it.
    fn run(&mut self, room: usize, x: &mut usize) -> Result<bool, String> {
        let mut left = room;
        while self.bits.one()? == 1 {
            let full = 1 << J[self.run_index];
            let count = left.min(full);
            (left, *x) = (left - count, *x + count);
            if count == full {
                self.run_index = (self.run_index + 1).min(31);
            }
            if left == 0 {
                return Ok(true);
            }
        }
        let count = self.bits.many(J[self.run_index])? as usize;
        if count >= left {
            return Err("a run beyond the end of a line".into());
        }
        *x += count;
        Ok(false)
    }

    /// The pixel at which a run ends (A.7.2).
    fn end_of_run(&mut self, a: i32, b: i32) -> Result<i32, String> {
        let kind = usize::from((a - b).abs() <= self.near);
        let context = self.contexts[CONTEXTS + kind];
        let sum = context.a + if kind == 1 { context.n >> 1 } else { 0 };
        let k = order(context.n, sum);
        let limit = self.limit - J[self.run_index] - 1;
        let mapped = self.bits.golomb(k, limit, self.qbpp)?;
        let code = mapped + kind as i32;
        let odd = code & 1 == 1;
        let size = (code + i32::from(odd)) / 2;
        let often = 2 * self.negative[kind] >= context.n;
        let error = if (k != 0 || often) == odd {
            -size
        } else {
            size
        };
        let context = &mut self.contexts[CONTEXTS + kind];
        self.negative[kind] += i32::from(error < 0);
        context.a += (mapped + 1 - kind as i32) >> 1;
        if context.n == self.reset {
            context.a >>= 1;
            context.n >>= 1;
            self.negative[kind] >>= 1;
        }
        context.n += 1;
        let (guess, sign) = match kind {
            1 => (a, 1),
            _ => (b, if a > b { -1 } else { 1 }),
        };
        Ok(self.value(guess, sign * error))
    }

    /// A pixel that is not in a run (A.4 to A.6).
    fn regular(&mut self, [a, b, c]: [i32; 3], gradients: [i32; 3]) -> Result<i32, String> {
        let [q1, q2, q3] = gradients.map(|g| self.quantised(g));
        let q = 81 * q1 + 9 * q2 + q3;
        let (sign, index) = if q < 0 { (-1, -q) } else { (1, q) };
        let context = self.contexts[index as usize];
        let guess = if c >= a.max(b) {
            a.min(b)
        } else if c <= a.min(b) {
            a.max(b)
        } else {
            a + b - c
        };
        let guess = (guess + sign * context.c).clamp(0, self.max);
        let k = order(context.n, context.a);
        let mapped = self.bits.golomb(k, self.limit, self.qbpp)?;
        let swapped = self.near == 0 && k == 0 && 2 * context.b <= -context.n;
        let error = match (mapped & 1 == 1, swapped) {
            (true, true) => mapped >> 1,
            (false, true) => -(mapped >> 1) - 1,
            (true, false) => -((mapped + 1) >> 1),
            (false, false) => mapped >> 1,
        };
        self.contexts[index as usize].learn(error, 2 * self.near + 1, self.reset);
        Ok(self.value(guess, sign * error))
    }

    fn quantised(&self, gradient: i32) -> i32 {
        let size = gradient.abs();
        let [t1, t2, t3] = self.thresholds;
        let level = if size <= self.near {
            0
        } else {
            1 + i32::from(size >= t1) + i32::from(size >= t2) + i32::from(size >= t3)
        };
        level * gradient.signum()
    }

    /// The pixel of a guess and its error, which counts modulo the range.
    fn value(&self, guess: i32, error: i32) -> i32 {
        let step = 2 * self.near + 1;
        let value = guess + error.saturating_mul(step).clamp(-(1 << 20), 1 << 20);
        let value = if value < -self.near {
            value + self.range * step
        } else if value > self.max + self.near {
            value - self.range * step
        } else {
            value
        };
        value.clamp(0, self.max)
    }
}

/// Golomb's order k: the least with n * 2^k >= sum.
fn order(n: i32, sum: i32) -> u32 {
    (0..24).find(|k| n << k >= sum).unwrap_or(24)
}

impl Context {
    /// Counts an error (A.6).
    fn learn(&mut self, error: i32, step: i32, reset: i32) {
        // a damaged scan must not overflow the sums
        let error = error.clamp(-(1 << 17), 1 << 17);
        self.b += error * step;
        self.a = (self.a + error.abs()).min(1 << 24);
        if self.n == reset {
            self.a >>= 1;
            self.b >>= 1;
            self.n >>= 1;
        }
        self.n += 1;
        if self.b <= -self.n {
            self.b += self.n;
            self.c = (self.c - 1).max(-128);
            self.b = self.b.max(1 - self.n);
        } else if self.b > 0 {
            self.b = (self.b - self.n).min(0);
            self.c = (self.c + 1).min(127);
        }
    }
}
