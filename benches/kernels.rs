//! Rates of the hot kernels on one core, on a foam of 256 x 256 x 256 voxels.
//!
//! ```sh
//! cargo bench --bench kernels
//! ```

use alvis::grid::Dims;
use alvis::kernels::Kernels;
use alvis::manifest::Primitives;
use alvis::phantom::{Phantom, render};
use alvis::volume::Dtype;
use criterion::{Criterion, Throughput, criterion_group, criterion_main};

fn kernels(criterion: &mut Criterion) {
    let dims = Dims::new([256; 3]).expect("a size that volumes have");
    let foam = render(&Phantom::default(), dims, Dtype::U8).expect("a phantom that can be made");
    let mut kernels = Kernels::new(&foam, 128).expect("memory can be read");
    let mut group = criterion.benchmark_group("voxels");
    group.sample_size(20);
    group.throughput(Throughput::Elements(kernels.voxels()));
    group.bench_function("classify", |b| b.iter(|| kernels.classify()));
    group.bench_function("label", |b| b.iter(|| kernels.label()));
    group.finish();
    let mut group = criterion.benchmark_group("triangles");
    group.sample_size(20);
    group.throughput(Throughput::Elements(kernels.triangles()));
    group.bench_function("surfaces", |b| b.iter(|| kernels.surfaces()));
    group.bench_function("mesh", |b| b.iter(|| kernels.mesh()));
    group.bench_function("strips", |b| b.iter(|| kernels.strips()));
    group.bench_function("lists to bytes", |b| {
        b.iter(|| kernels.bodies(Primitives::Triangles))
    });
    group.finish();
}

criterion_group!(benches, kernels);
criterion_main!(benches);
