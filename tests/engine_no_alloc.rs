//! After the first frame the engine allocates nothing: counted by the allocator itself.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

use edgecap::engine::model::{Calibration, RangeChoice};
use edgecap::engine::{
    CalibrationOptions, Engine, EngineOptions, FlipTest, Model, Network, Precision,
};

struct Counting;

static CALLS: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call goes to the system's allocator unchanged; counting touches no memory it hands out.
unsafe impl GlobalAlloc for Counting {
    /// # Safety
    /// As [`GlobalAlloc::alloc`].
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        CALLS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: `layout` is handed on as it is: its size is not 0 (caller).
        unsafe { System.alloc(layout) }
    }

    /// # Safety
    /// As [`GlobalAlloc::dealloc`].
    unsafe fn dealloc(&self, ptr: *mut u8, layout: Layout) {
        CALLS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: `ptr` and `layout` are handed on as they are: every block is the system's (`alloc`), and this one has
        // this layout (caller).
        unsafe { System.dealloc(ptr, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// One test in this file: another one's allocations would be counted too.
#[test]
fn frames_after_the_first_allocate_nothing() {
    let size = (64, 48);
    let rgb = vec![90; 3 * size.0 * size.1];
    let float = Model::random(Network::shipped("selecsls").unwrap(), 1);
    let options = CalibrationOptions {
        size,
        choice: RangeChoice::Max,
        ..CalibrationOptions::default()
    };
    let calibration = Calibration::observe(&float, [rgb.clone()], options).unwrap();
    let model = float.quantise(Some(&calibration)).unwrap();
    for precision in [Precision::Int8, Precision::F32] {
        for threads in [1, 2] {
            let options = EngineOptions {
                width: size.0,
                height: size.1,
                threads,
                precision,
                ..EngineOptions::default()
            };
            let mut engine = Engine::new(&model, options).unwrap();
            engine.run(&rgb);
            let before = CALLS.load(Ordering::Relaxed);
            for _ in 0..3 {
                engine.run(&rgb);
            }
            let calls = CALLS.load(Ordering::Relaxed) - before;
            assert_eq!(calls, 0, "{precision:?}, {threads} threads");
            let mut both = FlipTest::default();
            both.run(&mut engine, &rgb);
            let before = CALLS.load(Ordering::Relaxed);
            both.run(&mut engine, &rgb);
            let calls = CALLS.load(Ordering::Relaxed) - before;
            assert_eq!(calls, 0, "flip test, {precision:?}, {threads} threads");
        }
    }
    let before = CALLS.load(Ordering::Relaxed);
    std::hint::black_box(vec![0u8; 100]);
    assert!(
        CALLS.load(Ordering::Relaxed) > before,
        "the allocator counts"
    );
}
