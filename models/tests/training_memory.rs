//! A step of the training loop takes no fresh block of 4 KiB or more once it runs, but for
//! those of matrix products.
#![allow(clippy::unwrap_used, reason = "tests")]

use autodiff_lite::testkit::CountingAllocator;
use datasets::ReadOptions;
use models::img2mesh::Img2Mesh;
use train::progress::{Event, Watch};
use train::{Configuration, Job, Provenance, RunFolder, Source, System, train};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator::new();

#[test]
fn steps_of_a_training_take_no_large_fresh_block() {
    let mut config: Configuration<<Img2Mesh as System>::Config> = Configuration::default();
    config.train.epochs = 1;
    config.train.batch = 2;
    config.train.shards = 2;
    config.train.checkpoint_minutes = None;
    config.system.image_size = 32;
    config.system.render_size = 32;
    config.system.synthetic_views = 160;
    config.system.level = 2;
    let options = ReadOptions::default();
    let source = Source { path: None, options: &options, seed: 0, progress: &|_, _| () };
    let data = Img2Mesh::open(&config.system, &source).unwrap();
    let place = tempfile::tempdir().unwrap();
    let run = RunFolder::create(&place.path().join("run"), false).unwrap();
    let provenance = Provenance::default();
    let job = Job {
        config: &config,
        data: &data,
        run: &run,
        provenance: &provenance,
        resume: false,
        from: None,
    };
    let mut blocks = Vec::with_capacity(1000);
    let mut watch = Watch::new(|event: &Event| {
        if let Event::Step(_) = event {
            blocks.push([ALLOCATOR.blocks(), ALLOCATOR.bytes()]);
        }
    });
    train::<Img2Mesh>(&job, &mut watch).unwrap();
    drop(watch);
    // The gemm crate takes a packing buffer for each larger matrix product and gives it back: ten
    // here. Beside these a log or a list grows now and then.
    let (steps, last) = (blocks.len() - 20, blocks[blocks.len() - 1]);
    let [count, bytes] = [0, 1].map(|k| last[k] - blocks[19][k]);
    assert!(steps > 10 && last[0] > 0, "{steps} steps were counted");
    assert!(count <= 10 * steps + 4, "{count} blocks in {steps} steps");
    assert!(bytes <= 10 * steps * (512 << 10) + (64 << 10), "{bytes} bytes in {steps} steps");
}
