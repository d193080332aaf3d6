//! Phantoms: the same bytes however they are read, the statistics that are promised, and files that
//! say what they hold.

use alvis::grid::{Dims, Placement, Unit};
use alvis::phantom::{Foam, Phantom, PhantomVolume, Shape, render, write};
use alvis::progress::Quiet;
use alvis::volume::{Dtype, Volume};
use proptest::prelude::*;
use std::ops::Range;

fn foam(pitch: f64, wall: f64, bubble: f64) -> Shape {
    Shape::Foam(Foam {
        pitch,
        wall,
        bubble,
    })
}

fn shapes() -> Vec<Shape> {
    vec![
        Shape::Foam(Foam::default()),
        foam(10.0, 2.0, 0.9),
        Shape::Sphere { radius: 15.0 },
        Shape::Torus {
            radius: 12.0,
            tube: 5.0,
        },
        Shape::Cube { edge: 20.5 },
        Shape::Ellipsoid {
            semi_axes: [10.0, 14.0, 18.0],
        },
        Shape::Gyroid { period: 17.0 },
        Shape::Noise { density: 0.3 },
    ]
}

fn read(volume: &PhantomVolume, x: Range<u32>, y: Range<u32>, z: Range<u32>) -> Vec<u8> {
    let bytes = volume.header().dtype.bytes();
    let mut out = vec![0; x.len() * y.len() * z.len() * bytes];
    volume.read_box(x, y, z, &mut out).unwrap();
    out
}

fn whole(volume: &PhantomVolume) -> Vec<u8> {
    let [nx, ny, nz] = volume.header().dims.0;
    read(volume, 0..nx, 0..ny, 0..nz)
}

fn pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .unwrap()
}

/// Greys of a u8 phantom and its share of above voxels.
fn greys(shape: Shape, edge: u32) -> (Vec<u8>, f64) {
    let volume = render(&Phantom::new(shape), Dims([edge; 3]), Dtype::U8).unwrap();
    let bytes = whole(&volume);
    let above = bytes
        .iter()
        .filter(|&&v| f64::from(v) >= volume.threshold())
        .count();
    let share = above as f64 / bytes.len() as f64;
    (bytes, share)
}

#[test]
fn bytes_do_not_depend_on_threads() {
    let dims = Dims([70, 65, 75]);
    for shape in shapes() {
        let phantom = Phantom {
            shape,
            noise: 0.05,
            seed: 9,
        };
        let volume = render(&phantom, dims, Dtype::U16).unwrap();
        let one = pool(1).install(|| whole(&volume));
        assert!(one == pool(3).install(|| whole(&volume)), "{shape:?}");
        let other = render(
            &Phantom {
                seed: 10,
                ..phantom
            },
            dims,
            Dtype::U16,
        );
        assert!(one != whole(&other.unwrap()), "the seed matters: {shape:?}");
    }
}

#[test]
fn bytes_do_not_depend_on_the_volume_around_foam() {
    let phantom = Phantom::default();
    let small = render(&phantom, Dims([40, 40, 40]), Dtype::U8).unwrap();
    let large = render(&phantom, Dims([65_536, 65_536, 65_536]), Dtype::U8).unwrap();
    assert!(whole(&small) == read(&large, 0..40, 0..40, 0..40));
    // the far corner of the largest volume can be made at once
    let end = 65_536 - 50..65_536;
    let far = read(&large, end.clone(), end.clone(), end);
    assert!(far.contains(&51) && far.contains(&204));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]
    #[test]
    fn any_box_is_a_part_of_the_whole(
        shape in 0usize..8,
        corner in prop::array::uniform3(0u32..60),
        size in prop::array::uniform3(0u32..60),
    ) {
        let dims = Dims([67, 61, 63]);
        let phantom = Phantom { shape: shapes()[shape], noise: 0.07, seed: 3 };
        let volume = render(&phantom, dims, Dtype::I16).unwrap();
        let all = whole(&volume);
        let [x, y, z]: [Range<u32>; 3] =
            std::array::from_fn(|a| corner[a]..dims.0[a].min(corner[a] + size[a]));
        let part = read(&volume, x.clone(), y.clone(), z.clone());
        let mut expected = Vec::new();
        for k in z {
            for j in y.clone() {
                let at = |i| dims.linear([i, j, k]) as usize * 2;
                expected.extend_from_slice(&all[at(x.start)..at(x.end)]);
            }
        }
        prop_assert!(part == expected);
    }
}

/// The number of components of below voxels that meet at faces or edges (18 neighbours), and the
/// sizes of those that do not touch the faces of the volume, a cube of edge `n`.
fn cells(bytes: &[u8], threshold: f64, n: i64) -> (usize, Vec<usize>) {
    let mut seen: Vec<bool> = bytes.iter().map(|&v| f64::from(v) >= threshold).collect();
    let (mut count, mut closed) = (0, Vec::new());
    for start in 0..bytes.len() {
        if std::mem::replace(&mut seen[start], true) {
            continue;
        }
        let (mut stack, mut size, mut open) = (vec![start as i64], 0, false);
        while let Some(at) = stack.pop() {
            let [x, y, z] = [at % n, at / n % n, at / n / n];
            size += 1;
            open |= [x, y, z].iter().any(|&c| c == 0 || c == n - 1);
            for d in 0..27 {
                let [i, j, k] = [d % 3 - 1, d / 3 % 3 - 1, d / 9 - 1];
                let inside = [x + i, y + j, z + k].iter().all(|c| (0..n).contains(c));
                if i.abs() + j.abs() + k.abs() <= 2 && inside {
                    let next = at + i + n * (j + n * k);
                    if !std::mem::replace(&mut seen[next as usize], true) {
                        stack.push(next);
                    }
                }
            }
        }
        count += 1;
        if !open {
            closed.push(size);
        }
    }
    (count, closed)
}

#[test]
fn foam_has_one_closed_cell_per_site() {
    for (foam, noise) in [
        (Foam::default(), 0.0),
        (Foam::default(), 0.05),
        (
            Foam {
                pitch: 16.0,
                wall: 2.0,
                bubble: 1.0,
            },
            0.02,
        ),
    ] {
        let phantom = Phantom {
            shape: Shape::Foam(foam),
            noise,
            seed: 5,
        };
        let volume = render(&phantom, Dims([144; 3]), Dtype::U8).unwrap();
        let (count, closed) = cells(&whole(&volume), volume.threshold(), 144);
        // cells whose centre lies up to their radius outside are cut by the faces and count too
        let per_axis = 144.0 / foam.pitch;
        let reach = per_axis + 2.0 * foam.bubble.min(0.55);
        assert!((count as f64) > per_axis.powi(3), "{foam:?}: {count}");
        assert!((count as f64) < 1.15 * reach.powi(3), "{foam:?}: {count}");
        let closed_at_least = (per_axis - 1.5).powi(3);
        assert!(closed.len() as f64 > closed_at_least, "{}", closed.len());
        let cell = foam.pitch.powi(3);
        for size in closed {
            let share = size as f64 / cell;
            assert!(
                (0.02..1.5).contains(&share),
                "{foam:?} {noise}: {size} voxels"
            );
        }
    }
}

#[test]
fn foam_surface_is_as_large_as_promised() {
    let (bytes, metal) = greys(Shape::Foam(Foam::default()), 160);
    let n = 160;
    let above = |i: usize| bytes[i] >= 128;
    let mut changes = 0;
    for i in 0..bytes.len() {
        let [x, y, z] = [i % n, i / n % n, i / n / n];
        for (inside, step) in [(x + 1 < n, 1), (y + 1 < n, n), (z + 1 < n, n * n)] {
            changes += usize::from(inside && above(i) != above(i + step));
        }
    }
    // one vertex per sign change, and a closed surface has near two triangles per vertex
    let triangles = 2.0 * changes as f64 / bytes.len() as f64;
    assert!(
        (0.2..0.28).contains(&triangles),
        "{triangles} triangles per voxel"
    );
    assert!((0.6..0.85).contains(&metal), "{metal} metal");
    let (_, metal) = greys(foam(24.0, 3.0, 0.9), 160);
    assert!(
        (0.25..0.45).contains(&metal),
        "{metal} metal with flat cells"
    );
}

#[test]
fn bodies_have_the_volume_of_their_formula() {
    use std::f64::consts::PI;
    let voxels = 96f64.powi(3);
    let ball = 4.0 / 3.0 * PI;
    for (shape, volume) in [
        (Shape::Sphere { radius: 40.0 }, ball * 40f64.powi(3)),
        (
            Shape::Torus {
                radius: 30.0,
                tube: 12.0,
            },
            2.0 * PI * PI * 30.0 * 144.0,
        ),
        (Shape::Cube { edge: 60.0 }, 60f64.powi(3)),
        (
            Shape::Ellipsoid {
                semi_axes: [20.0, 30.0, 45.0],
            },
            ball * 20.0 * 30.0 * 45.0,
        ),
        (Shape::Gyroid { period: 32.0 }, voxels / 2.0),
        (Shape::Noise { density: 0.3 }, 0.3 * voxels),
    ] {
        let (_, share) = greys(shape, 96);
        let error = share * voxels / volume - 1.0;
        assert!(error.abs() < 0.005, "{shape:?}: off by {error}");
    }
}

#[test]
fn the_sphere_is_interpolated_as_well_as_chords_can() {
    let dims = Dims([64; 3]);
    let sphere = Phantom::new(Shape::Sphere { radius: 25.3 });
    let volume = render(&sphere, dims, Dtype::F32).unwrap();
    let bytes = whole(&volume);
    let value = |p: [u32; 3]| {
        let at = dims.linear(p) as usize * 4;
        f64::from(f32::from_ne_bytes(bytes[at..at + 4].try_into().unwrap()))
    };
    let (mut found, mut worst) = (0, 0.0f64);
    for i in 0..63 * 64 * 64 {
        let p = [i % 63, i / 63 % 64, i / 63 / 64];
        let (v0, v1) = (value(p), value([p[0] + 1, p[1], p[2]]));
        if (v0 >= 0.5) != (v1 >= 0.5) {
            let x = f64::from(p[0]) + (0.5 - v0) / (v1 - v0) - 31.5;
            let (y, z) = (f64::from(p[1]) - 31.5, f64::from(p[2]) - 31.5);
            worst = worst.max(((x * x + y * y + z * z).sqrt() - 25.3).abs());
            found += 1;
        }
    }
    // the distance along an edge of length 1 is off a straight line by 1/(8 r) at most
    assert!(
        found > 3000 && worst < 1.0 / (8.0 * 25.3) + 1e-4,
        "{found} {worst}"
    );
}

#[test]
fn every_type_shows_the_same_body() {
    let dims = Dims([24; 3]);
    let sphere = Phantom {
        noise: 0.05,
        ..Phantom::new(Shape::Sphere { radius: 8.2 })
    };
    let bits = |dtype: Dtype| -> Vec<bool> {
        let volume = render(&sphere, dims, dtype).unwrap();
        let value = |b: &[u8]| match dtype {
            Dtype::U8 => f64::from(b[0]),
            Dtype::I8 => f64::from(b[0] as i8),
            Dtype::U16 => f64::from(u16::from_ne_bytes(b.try_into().unwrap())),
            Dtype::I16 => f64::from(i16::from_ne_bytes(b.try_into().unwrap())),
            Dtype::U32 => f64::from(u32::from_ne_bytes(b.try_into().unwrap())),
            Dtype::I32 => f64::from(i32::from_ne_bytes(b.try_into().unwrap())),
            Dtype::F32 => f64::from(f32::from_ne_bytes(b.try_into().unwrap())),
            Dtype::F64 => f64::from_ne_bytes(b.try_into().unwrap()),
        };
        whole(&volume)
            .chunks(dtype.bytes())
            .map(|b| value(b) >= volume.threshold())
            .collect()
    };
    let reference = bits(Dtype::F64);
    assert!(reference.contains(&true) && reference.contains(&false));
    for dtype in Dtype::ALL {
        let own = bits(dtype);
        let differing = own.iter().zip(&reference).filter(|(a, b)| a != b).count();
        // samples within rounding of the threshold may fall on either side
        assert!(differing <= 20, "{dtype}: {differing} voxels differ");
    }
}

#[test]
fn impossible_parameters_are_refused() {
    for (shape, option) in [
        (foam(4.0, 2.0, 0.42), "--pitch"),
        (foam(f64::NAN, 3.0, 0.42), "--pitch"),
        (foam(24.0, 1.0, 0.42), "--wall"),
        (foam(24.0, 9.0, 0.42), "--wall"),
        (foam(24.0, 3.0, 2.0), "--bubble"),
        (Shape::Sphere { radius: -1.0 }, "--radius"),
        (
            Shape::Sphere {
                radius: f64::INFINITY,
            },
            "--radius",
        ),
        (
            Shape::Torus {
                radius: 3.0,
                tube: 4.0,
            },
            "--tube",
        ),
        (Shape::Cube { edge: 0.0 }, "--edge"),
        (
            Shape::Ellipsoid {
                semi_axes: [1.0, 0.0, 1.0],
            },
            "--semi-axes",
        ),
        (Shape::Gyroid { period: 1.0 }, "--pitch"),
        (Shape::Noise { density: 1.5 }, "--density"),
    ] {
        let error = render(&Phantom::new(shape), Dims([8; 3]), Dtype::U8).unwrap_err();
        let start = format!("{option}: found ");
        assert!(error.to_string().starts_with(&start), "{error}");
    }
    let noisy = Phantom {
        noise: -0.1,
        ..Phantom::default()
    };
    assert!(render(&noisy, Dims([8; 3]), Dtype::U8).is_err());
}

#[test]
fn files_hold_header_and_samples() {
    let dir = tempfile::tempdir().unwrap();
    let place = Placement {
        spacing: [0.5, 0.25, 2.0],
        unit: Unit::Micrometre,
        ..Placement::default()
    };
    let phantom = Phantom {
        noise: 0.1,
        ..Phantom::default()
    };
    let bare = render(&phantom, Dims([33, 20, 9]), Dtype::U16).unwrap();
    let placed = bare.clone().with_placement(place).unwrap();
    let samples = whole(&bare);
    let file = |name: &str, volume: &PhantomVolume| {
        let path = dir.path().join(name);
        let written = write(volume, &path, false, &Quiet).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let beside = written
            .data
            .map_or(0, |d| std::fs::metadata(d).unwrap().len());
        assert_eq!(written.bytes, bytes.len() as u64 + beside);
        bytes
    };
    assert!(file("a.raw", &placed) == samples);
    let head = "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n\
        CompressedData = False\n";
    let space = "TransformMatrix = 1 0 0 0 1 0 0 0 1\nOffset = 0 0 0\n\
        ElementSpacing = 0.5 0.25 2\nDistanceUnits = um\n";
    let tail = "DimSize = 33 20 9\nElementType = MET_USHORT\nElementDataFile = ";
    assert_eq!(
        String::from_utf8(file("b.mhd", &placed)).unwrap(),
        format!("{head}{space}{tail}b.raw\n")
    );
    assert!(std::fs::read(dir.path().join("b.raw")).unwrap() == samples);
    let expected = format!("{head}{tail}LOCAL\n");
    assert!(file("c.mha", &bare) == [expected.as_bytes(), &samples].concat());
    let expected = "NRRD0004\ntype: uint16\ndimension: 3\nsizes: 33 20 9\nspace dimension: 3\n\
        space directions: (0.5,0,0) (0,0.25,0) (0,0,2)\nspace origin: (0,0,0)\n\
        space units: \"um\" \"um\" \"um\"\nendian: little\nencoding: raw\n\n";
    assert!(file("d.nrrd", &placed) == [expected.as_bytes(), &samples].concat());
}

#[test]
fn files_are_replaced_only_on_request() {
    let dir = tempfile::tempdir().unwrap();
    let volume = render(&Phantom::default(), Dims([8; 3]), Dtype::U8).unwrap();
    let path = dir.path().join("a.mhd");
    // the file with the samples is protected as well
    std::fs::write(dir.path().join("a.raw"), "precious").unwrap();
    let error = write(&volume, &path, false, &Quiet)
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("a.raw") && error.contains("--force"),
        "{error}"
    );
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
    write(&volume, &path, true, &Quiet).unwrap();
    let samples = std::fs::metadata(dir.path().join("a.raw")).unwrap();
    assert_eq!(samples.len(), 512);
    for bad in ["a.png", "none/a.raw", "raw"] {
        assert!(write(&volume, &dir.path().join(bad), false, &Quiet).is_err());
    }
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 2);
}

#[cfg(target_os = "linux")]
#[test]
fn a_killed_command_leaves_no_file() {
    use std::os::unix::fs::OpenOptionsExt;
    let dir = tempfile::tempdir().unwrap();
    let nameless = std::fs::File::options()
        .write(true)
        .custom_flags(libc::O_TMPFILE)
        .open(dir.path());
    if let Err(e) = nameless {
        eprintln!("SKIPPED: no files without a name in the temporary directory: {e}");
        return;
    }
    let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_alvis"))
        .args(["phantom", "noise", "v.mhd", "--dims", "2000,2000,2000"])
        .arg("--quiet")
        .current_dir(dir.path())
        .spawn()
        .unwrap();
    // bytes that it has handed to the system
    let written = || {
        let io = std::fs::read_to_string(format!("/proc/{}/io", child.id())).unwrap();
        let line = io.lines().find_map(|l| l.strip_prefix("wchar: "));
        line.unwrap().parse::<u64>().unwrap()
    };
    while written() < 1_000_000 {
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    child.kill().unwrap();
    assert_eq!(child.wait().unwrap().code(), None);
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
}
