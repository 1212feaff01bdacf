//! AMX with int8: tiles of 16 rows × 64 bytes. `tdpbusd` adds the products of 16 × 64 u8 and 64 × 16 i8 to 16 × 16 i32.
//!
//! Written in assembly: the compiler's intrinsics are not stable. Tile registers are alive within one `asm!` only; what
//! lives longer is their configuration, which [`Tiles`] owns.

mod granted;

use std::arch::asm;
use std::marker::PhantomData;

pub(crate) use granted::is_granted;

/// Most rows of a tile: pixels of inputs and sums, 32-bit groups of channels of weights.
pub(crate) const ROWS: usize = 16;

/// Output channels in a row of a tile of sums.
pub(crate) const LANES: usize = 16;

/// Bytes in a whole row of a tile.
const ROW_BYTES: u16 = 64;

/// Tiles of sums that are computed together; with inputs and weights they take all 8 tile registers.
pub(crate) const SUMS: usize = 4;

/// Sums of [`SUMS`] tiles, row after row. Without the initial values: they are added to what is read from here, since
/// loading them into tiles takes as long as a product.
#[repr(C, align(64))]
pub(crate) struct Sums(pub [[[i32; LANES]; ROWS]; SUMS]);

/// What `ldtilecfg` reads: palette 1, bytes per row and rows of every tile register.
#[repr(C, align(64))]
struct Config {
    palette: u8,
    start_row: u8,
    reserved: [u8; 14],
    row_bytes: [u16; 16],
    rows: [u8; 16],
}

/// This thread's tiles: registers 0 to 3 hold sums, 4 and 5 inputs, 6 and 7 weights. Released when dropped: a thread
/// whose tiles are in use makes the system save 8 KiB more whenever it is suspended.
pub(crate) struct Tiles {
    pixels: usize,
    groups: usize,
    /// Registers are a thread's: neither the tiles nor a reference to them may leave it.
    thread: PhantomData<*mut ()>,
}

/// Does not compile where tiles could be sent to another thread or shared with it: then more than one `impl` fits.
const _: fn() = || {
    trait Stays<A> {
        fn stays() {}
    }
    impl<T> Stays<()> for T {}
    impl<T: Send> Stays<[(); 1]> for T {}
    impl<T: Sync> Stays<[(); 2]> for T {}
    <Tiles as Stays<_>>::stays();
};

impl Tiles {
    /// Tiles of `pixels` rows and `groups` 32-bit groups of channels.
    ///
    /// # Safety
    /// [`is_granted`]; nobody else has this thread's tiles.
    pub unsafe fn new(pixels: usize, groups: usize) -> Self {
        let mut tiles = Self {
            pixels: 0,
            groups: 0,
            thread: PhantomData,
        };
        // SAFETY: the caller's contract.
        unsafe { tiles.resize(pixels, groups) };
        tiles
    }

    /// Makes them `pixels` × `groups` where they are not.
    ///
    /// # Safety
    /// [`is_granted`].
    pub unsafe fn resize(&mut self, pixels: usize, groups: usize) {
        if (self.pixels, self.groups) == (pixels, groups) {
            return;
        }
        // Anything else would fault.
        let (whole, most) = (1..=ROWS, ROWS);
        assert!(
            whole.contains(&pixels) && whole.contains(&groups),
            "tiles of at most {most} rows"
        );
        (self.pixels, self.groups) = (pixels, groups);
        let mut config = Config {
            palette: 1,
            start_row: 0,
            reserved: [0; 14],
            row_bytes: [0; 16],
            rows: [0; 16],
        };
        for (tile, (row_bytes, rows)) in config
            .row_bytes
            .iter_mut()
            .zip(&mut config.rows)
            .take(8)
            .enumerate()
        {
            (*row_bytes, *rows) = match tile {
                0..4 => (ROW_BYTES, pixels as u8),
                4..6 => (4 * groups as u16, pixels as u8),
                _ => (ROW_BYTES, groups as u8),
            };
        }
        // SAFETY: reads the 64 bytes of `config`. It is valid: palette 1 has 8 registers of at most 16 rows of 64 bytes
        // (`is_granted` asks the CPU), 1 <= pixels, groups <= 16 (asserted above), so 4 <= row bytes <= 64.
        unsafe {
            asm!(
                "ldtilecfg [{config}]",
                config = in(reg) &config,
                out("tmm0") _, out("tmm1") _, out("tmm2") _, out("tmm3") _,
                out("tmm4") _, out("tmm5") _, out("tmm6") _, out("tmm7") _,
                options(nostack, readonly, preserves_flags)
            );
        }
    }

    /// Two tiles of pixels × two of outputs: `sums[2 · p + v] = Σ steps inputs[p] · weights[v]`.
    ///
    /// # Safety
    /// [`is_granted`]. For every offset, both inputs plus it are `pixels` rows of `4 · groups` readable bytes, `stride`
    /// bytes apart; `weights` are `offsets.len() · groups` rows of 128 readable bytes. `offsets` is not empty.
    #[inline(always)]
    pub unsafe fn two_by_two(
        &self,
        inputs: [*const u8; 2],
        stride: usize,
        offsets: &[isize],
        weights: *const u8,
        sums: &mut Sums,
    ) {
        let end = offsets.as_ptr_range().end;
        // SAFETY: tiles read and write what their configuration says: inputs and weights as the caller promises, where
        // the step from one offset's weights to the next is groups · 128 bytes; of every tile of `sums`
        // `pixels <= ROWS` rows. The loop reads the offsets up to `end`, the first before it compares: there is one
        // (caller).
        unsafe {
            asm!(
                "tilezero tmm0",
                "tilezero tmm1",
                "tilezero tmm2",
                "tilezero tmm3",
                "2:",
                "mov {x}, [{offset}]",
                "add {offset}, 8",
                "tileloadd tmm6, [{weights} + {row}*1]",
                "lea {x1}, [{input1} + {x}]",
                "add {x}, {input0}",
                "tileloadd tmm4, [{x} + {stride}*1]",
                "tdpbusd tmm0, tmm4, tmm6",
                "tileloadd tmm7, [{weights} + {row}*1 + 64]",
                "tdpbusd tmm1, tmm4, tmm7",
                "tileloadd tmm5, [{x1} + {stride}*1]",
                "tdpbusd tmm2, tmm5, tmm6",
                "tdpbusd tmm3, tmm5, tmm7",
                "add {weights}, {step}",
                "cmp {offset}, {end}",
                "jb 2b",
                "mov {row:e}, 64",
                "tilestored [{sums} + {row}*1], tmm0",
                "tilestored [{sums} + {row}*1 + 1024], tmm1",
                "tilestored [{sums} + {row}*1 + 2048], tmm2",
                "tilestored [{sums} + {row}*1 + 3072], tmm3",
                row = inout(reg) 128usize => _,
                offset = inout(reg) offsets.as_ptr() => _,
                end = in(reg) end,
                input0 = in(reg) inputs[0],
                input1 = in(reg) inputs[1],
                x = out(reg) _,
                x1 = out(reg) _,
                stride = in(reg) stride,
                weights = inout(reg) weights => _,
                step = in(reg) self.groups * 128,
                sums = in(reg) sums.0.as_mut_ptr(),
                out("tmm0") _, out("tmm1") _, out("tmm2") _, out("tmm3") _,
                out("tmm4") _, out("tmm5") _, out("tmm6") _, out("tmm7") _,
                options(nostack)
            );
        }
    }

    /// Four tiles of pixels × one of outputs: `sums[p] = Σ steps inputs[p] · weights`.
    ///
    /// # Safety
    /// As [`two_by_two`](Self::two_by_two), with rows of 64 bytes of weights.
    #[inline(always)]
    pub unsafe fn four_by_one(
        &self,
        inputs: [*const u8; 4],
        stride: usize,
        offsets: &[isize],
        weights: *const u8,
        sums: &mut Sums,
    ) {
        let end = offsets.as_ptr_range().end;
        // The others as distances from the first: one register less in the loop.
        let distance = |i: usize| (inputs[i] as usize).wrapping_sub(inputs[0] as usize);
        // SAFETY: as in `two_by_two`; the step from one offset's weights to the next is groups · 64 bytes.
        unsafe {
            asm!(
                "tilezero tmm0",
                "tilezero tmm1",
                "tilezero tmm2",
                "tilezero tmm3",
                "2:",
                "mov {x}, [{offset}]",
                "add {offset}, 8",
                "tileloadd tmm6, [{weights} + {row}*1]",
                "add {x}, {input}",
                "tileloadd tmm4, [{x} + {stride}*1]",
                "tdpbusd tmm0, tmm4, tmm6",
                "lea {y}, [{x} + {second}]",
                "tileloadd tmm5, [{y} + {stride}*1]",
                "tdpbusd tmm1, tmm5, tmm6",
                "lea {y}, [{x} + {third}]",
                "tileloadd tmm4, [{y} + {stride}*1]",
                "tdpbusd tmm2, tmm4, tmm6",
                "add {x}, {fourth}",
                "tileloadd tmm5, [{x} + {stride}*1]",
                "tdpbusd tmm3, tmm5, tmm6",
                "add {weights}, {step}",
                "cmp {offset}, {end}",
                "jb 2b",
                "tilestored [{sums} + {row}*1], tmm0",
                "tilestored [{sums} + {row}*1 + 1024], tmm1",
                "tilestored [{sums} + {row}*1 + 2048], tmm2",
                "tilestored [{sums} + {row}*1 + 3072], tmm3",
                row = in(reg) 64usize,
                offset = inout(reg) offsets.as_ptr() => _,
                end = in(reg) end,
                input = in(reg) inputs[0],
                second = in(reg) distance(1),
                third = in(reg) distance(2),
                fourth = in(reg) distance(3),
                x = out(reg) _,
                y = out(reg) _,
                stride = in(reg) stride,
                weights = inout(reg) weights => _,
                step = in(reg) self.groups * 64,
                sums = in(reg) sums.0.as_mut_ptr(),
                out("tmm0") _, out("tmm1") _, out("tmm2") _, out("tmm3") _,
                out("tmm4") _, out("tmm5") _, out("tmm6") _, out("tmm7") _,
                options(nostack)
            );
        }
    }
}

impl Drop for Tiles {
    fn drop(&mut self) {
        // SAFETY: `Tiles` exist only where they are granted; they are this thread's, and no sum is left in them.
        unsafe {
            asm!(
                "tilerelease",
                out("tmm0") _, out("tmm1") _, out("tmm2") _, out("tmm3") _,
                out("tmm4") _, out("tmm5") _, out("tmm6") _, out("tmm7") _,
                options(nostack, nomem, preserves_flags)
            );
        }
    }
}

/// `steps` times four independent products of whole tiles, as many as hide their latency; returns the
/// multiply-accumulates.
///
/// # Safety
/// [`is_granted`].
pub(crate) unsafe fn products(steps: u64) -> u64 {
    // SAFETY: the caller's contract; the tiles are not kept across a call.
    let tiles = unsafe { Tiles::new(ROWS, ROWS) };
    // SAFETY: registers only.
    unsafe {
        asm!(
            "tilezero tmm0", "tilezero tmm1", "tilezero tmm2", "tilezero tmm3",
            "tilezero tmm4", "tilezero tmm5", "tilezero tmm6", "tilezero tmm7",
            "test {steps}, {steps}",
            "jz 3f",
            "2:",
            "tdpbusd tmm0, tmm4, tmm6",
            "tdpbusd tmm1, tmm4, tmm7",
            "tdpbusd tmm2, tmm5, tmm6",
            "tdpbusd tmm3, tmm5, tmm7",
            "dec {steps}",
            "jnz 2b",
            "3:",
            steps = inout(reg) steps => _,
            out("tmm0") _, out("tmm1") _, out("tmm2") _, out("tmm3") _,
            out("tmm4") _, out("tmm5") _, out("tmm6") _, out("tmm7") _,
            options(nostack, nomem)
        );
    }
    drop(tiles);
    steps * (SUMS * ROWS * LANES * 4 * ROWS) as u64
}
