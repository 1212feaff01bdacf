//! No inner loop of a kernel keeps a vector on the stack: shown by disassembling the built test program itself.
//!
//! A tile that needs one register too many still computes the right thing, at two thirds of the speed (a 4×3 tile of
//! AVX-VNNI did), on CPUs that nobody tests on.
#![cfg(all(target_arch = "x86_64", target_os = "linux", not(debug_assertions)))]

use std::process::Command;

use edgecap_kernels::Isa;

/// An instruction: address, text behind it.
type Line = (u64, String);

/// Functions of the program whose symbol contains `what`.
fn functions(text: &str, what: &str) -> Vec<(String, Vec<Line>)> {
    let mut all: Vec<(String, Vec<Line>)> = Vec::new();
    let mut wanted = false;
    for line in text.lines() {
        if let Some(name) = line.strip_suffix(">:") {
            wanted = name.contains(what);
            if wanted {
                all.push((
                    name.rsplit('<').next().unwrap_or(name).to_owned(),
                    Vec::new(),
                ));
            }
        } else if wanted && let Some((address, code)) = line.split_once(":\t") {
            let address = u64::from_str_radix(address.trim(), 16).expect("an address");
            all.last_mut()
                .expect("a function")
                .1
                .push((address, code.to_owned()));
        }
    }
    all
}

/// Innermost loops: from the target of a jump backwards to the jump, with no other such loop inside.
fn innermost_loops(code: &[Line]) -> Vec<&[Line]> {
    let mut loops = Vec::new();
    for (end, (address, text)) in code.iter().enumerate() {
        let Some(target) = text
            .strip_prefix('j')
            .and_then(|t| t.split_whitespace().nth(1))
        else {
            continue;
        };
        let Ok(target) = u64::from_str_radix(target, 16) else {
            continue;
        };
        if target <= *address
            && let Ok(start) = code.binary_search_by_key(&target, |line| line.0)
        {
            loops.push((start, end));
        }
    }
    let contains = |a: &(usize, usize), b: &(usize, usize)| a != b && a.0 <= b.0 && b.1 <= a.1;
    let inner = loops
        .iter()
        .filter(|a| !loops.iter().any(|b| contains(a, b)));
    inner.map(|&(start, end)| &code[start..=end]).collect()
}

fn has_vector(line: &Line) -> bool {
    ["%xmm", "%ymm", "%zmm"].iter().any(|r| line.1.contains(r))
}

/// Whether a vector is read from or written to a place of its own on the stack (an array there is indexed).
fn is_on_stack(line: &Line) -> bool {
    has_vector(line) && line.1.contains("(%rsp)")
}

fn is_product(line: &Line) -> bool {
    let products = ["dpbusd", "dpwssd", "maddubs", "maddwd", "mulps", "fmadd"];
    products.iter().any(|p| line.1.contains(p))
}

/// Whether an instruction belongs to what becomes of sums: conversions, and stores anywhere but on the stack.
fn is_epilogue(line: &Line) -> bool {
    let is_store = line.1.trim_end().ends_with(')') && line.1.contains("mov");
    line.1.contains("cvt") || (has_vector(line) && is_store && !line.1.contains("(%rsp"))
}

#[test]
fn no_inner_loop_spills() {
    let program = std::env::current_exe().expect("this program's path");
    // Names the kernels, so that the linker keeps them.
    assert!(Isa::ALL.iter().any(|isa| isa.is_available()));
    let out = Command::new("objdump")
        .args(["-d", "--no-show-raw-insn", "--demangle"])
        .arg(&program)
        .output();
    let out = match out {
        Ok(out) if out.status.success() => out,
        other => {
            println!("SKIPPED: no disassembly, objdump (binutils) is needed: {other:?}");
            return;
        }
    };
    let text = String::from_utf8_lossy(&out.stdout);
    let mut loops_with_products = 0;
    for kernel in [
        "DIRECT_SSE41",
        "WIDE_SSE41",
        "WINOGRAD_SSE41",
        "F32_SSE41",
        "DIRECT_AVX2",
        "WIDE_AVX2",
        "WINOGRAD_AVX2",
        "F32_AVX2",
        "DIRECT_AVXVNNI",
        "WINOGRAD_AVXVNNI",
        "DIRECT_AVX512",
        "WIDE_AVX512",
        "WINOGRAD_AVX512",
        "F32_AVX512",
        "DIRECT_AVX512VNNI",
        "WINOGRAD_AVX512VNNI",
    ] {
        let found = functions(&text, &format!("::{kernel}::"));
        assert!(!found.is_empty(), "no function of {kernel} in this program");
        for (name, code) in found {
            for inner in innermost_loops(&code) {
                if !inner.iter().any(is_product) || inner.iter().any(is_epilogue) {
                    continue;
                }
                loops_with_products += 1;
                let spills: Vec<_> = inner.iter().filter(|l| is_on_stack(l)).collect();
                assert!(spills.is_empty(), "{name}: {spills:#x?}");
            }
        }
    }
    println!("{loops_with_products} inner loops of products, none with a vector on the stack");
    assert!(loops_with_products > 60, "{loops_with_products} loops");
}
