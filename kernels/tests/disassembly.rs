//! No inner loop of a kernel keeps a vector on the stack, and dot products are what the CPU has for them: shown by
//! disassembling the built test program itself.
//!
//! A tile that needs one register too many still computes the right thing, at two thirds of the speed (a 4×3 tile of
//! AVX-VNNI did), on CPUs that nobody tests on.
#![cfg(all(
    any(target_arch = "x86_64", target_arch = "aarch64"),
    target_os = "linux",
    not(debug_assertions)
))]

#[path = "../../tests/program/tools.rs"]
mod tools;

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

/// Where a jump goes; `None` for every other instruction.
fn jump_target(text: &str) -> Option<u64> {
    let mut words = text.split_whitespace();
    let name = words.next()?;
    let jumps = if cfg!(target_arch = "x86_64") {
        name.starts_with('j')
    } else {
        name == "b" || name.starts_with("b.") || name.starts_with("cb") || name.starts_with("tb")
    };
    let target = words.take_while(|word| !word.starts_with('<')).last()?;
    jumps
        .then(|| u64::from_str_radix(target, 16).ok())
        .flatten()
}

/// Innermost loops: from the target of a jump backwards to the jump, with no other such loop inside.
fn innermost_loops(code: &[Line]) -> Vec<&[Line]> {
    let mut loops = Vec::new();
    for (end, (address, text)) in code.iter().enumerate() {
        let Some(target) = jump_target(text) else {
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

/// Whether an operand is a whole vector.
fn has_vector(line: &Line) -> bool {
    if cfg!(target_arch = "x86_64") {
        return ["%xmm", "%ymm", "%zmm"].iter().any(|r| line.1.contains(r));
    }
    let operands = line.1.split(|c: char| !c.is_ascii_alphanumeric());
    operands.skip(1).any(|word| {
        let register = word.strip_prefix(['q', 'v']);
        register.is_some_and(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()))
    })
}

/// The stack, as an address without an index is written.
const STACK: &str = if cfg!(target_arch = "x86_64") {
    "(%rsp)"
} else {
    "[sp"
};

/// Whether a vector is read from or written to a place of its own on the stack (an array there is indexed).
fn is_on_stack(line: &Line) -> bool {
    has_vector(line) && line.1.contains(STACK)
}

const PRODUCTS: &[&str] = if cfg!(target_arch = "x86_64") {
    &["dpbusd", "dpwssd", "maddubs", "maddwd", "mulps", "fmadd"]
} else {
    &["dot", "usmmla", "smull", "smlal", "fmla"]
};

fn is_product(line: &Line) -> bool {
    PRODUCTS.iter().any(|p| line.1.contains(p))
}

/// Whether an instruction belongs to what becomes of sums: conversions, stores anywhere but on the stack, and copies of
/// a few lanes. Another call does not: in a loop of products it would be a product that was not inlined.
fn is_epilogue(line: &Line) -> bool {
    if line.1.contains("<memcpy") {
        return true;
    }
    if cfg!(target_arch = "aarch64") {
        return line.1.contains("cvt") || (line.1.starts_with("st") && !line.1.contains(STACK));
    }
    // A mask stands behind the address.
    let operands = line.1.split('{').next().unwrap_or(&line.1);
    let is_store = operands.trim_end().ends_with(')') && line.1.contains("mov");
    line.1.contains("cvt") || (has_vector(line) && is_store && !line.1.contains("(%rsp"))
}

/// Whether an instruction belongs to Winograd's transforms in f32, which multiply as well, and go through the stack.
fn is_transform(line: &Line) -> bool {
    let differences = if cfg!(target_arch = "x86_64") {
        ["subps", "fnmadd", "vaddps"]
    } else {
        ["fsub", "fmls", "fadd"]
    };
    differences.iter().any(|name| line.1.contains(name))
}

#[cfg(target_arch = "x86_64")]
const KERNELS: &[&str] = &[
    "DIRECT_SSE41",
    "WIDE_SSE41",
    "WINOGRAD_SSE41",
    "F32_SSE41",
    "WINOGRAD_F32_SSE41",
    "DIRECT_AVX2",
    "WIDE_AVX2",
    "WINOGRAD_AVX2",
    "F32_AVX2",
    "WINOGRAD_F32_AVX2",
    "DIRECT_AVXVNNI",
    "WINOGRAD_AVXVNNI",
    "DIRECT_AVX512",
    "WIDE_AVX512",
    "WINOGRAD_AVX512",
    "F32_AVX512",
    "WINOGRAD_F32_AVX512",
    "DIRECT_AVX512VNNI",
    "WINOGRAD_AVX512VNNI",
];
#[cfg(target_arch = "aarch64")]
const KERNELS: &[&str] = &[
    "DIRECT_NEON",
    "WIDE_NEON",
    "WINOGRAD_NEON",
    "F32_NEON",
    "WINOGRAD_F32_NEON",
    "DIRECT_NEONDOT",
    "DIRECT_NEONI8MM",
    "DOT_NEONI8MM",
];
/// Kernels whose products the CPU also adds up, and by what.
#[cfg(target_arch = "x86_64")]
const DOTS: &[(&str, &str)] = &[
    ("DIRECT_AVXVNNI", "vpdpbusd"),
    ("WINOGRAD_AVXVNNI", "vpdpwssd"),
    ("DIRECT_AVX512VNNI", "vpdpbusd"),
    ("WINOGRAD_AVX512VNNI", "vpdpwssd"),
];
#[cfg(target_arch = "aarch64")]
const DOTS: &[(&str, &str)] = &[
    ("DIRECT_NEONDOT", "sdot"),
    ("DIRECT_NEONI8MM", "usmmla"),
    ("DOT_NEONI8MM", "usdot"),
];
/// The kernels' loops are unrolled for so many tiles each at least.
const LEAST_LOOPS: usize = 4;

/// The program that takes this one apart; under emulation it is the other architecture's.
fn objdump() -> Command {
    let cross = "aarch64-linux-gnu-objdump";
    let found =
        cfg!(target_arch = "aarch64") && Command::new(cross).arg("--version").output().is_ok();
    Command::new(if found { cross } else { "objdump" })
}

/// This program taken apart, or `None`, said aloud, where that cannot be done.
fn disassembly() -> Option<String> {
    let program = std::env::current_exe().expect("this program's path");
    // Names the kernels, so that the linker keeps them.
    assert!(Isa::ALL.iter().any(|isa| isa.is_available()));
    let out = objdump()
        .args(["-d", "--no-show-raw-insn", "--demangle"])
        .arg(&program)
        .output();
    match out {
        Ok(out) if out.status.success() => Some(String::from_utf8_lossy(&out.stdout).into_owned()),
        other => {
            let why = format!("no disassembly, objdump (binutils) is needed: {other:?}");
            tools::skip("objdump", &why);
            None
        }
    }
}

/// The innermost loops of a kernel that multiply, with the function that each belongs to.
fn loops_of_products(text: &str, kernel: &str) -> Vec<(String, Vec<Line>)> {
    let found = functions(text, &format!("::{kernel}::"));
    assert!(!found.is_empty(), "no function of {kernel} in this program");
    let mut loops = Vec::new();
    for (name, code) in &found {
        for inner in innermost_loops(code) {
            let other = |line: &Line| is_epilogue(line) || is_transform(line);
            if inner.iter().any(is_product) && !inner.iter().any(other) {
                loops.push((name.clone(), inner.to_vec()));
            }
        }
    }
    loops
}

#[test]
fn a_dot_product_is_one_instruction_where_the_cpu_has_one() {
    let Some(text) = disassembly() else {
        return;
    };
    const { assert!(!DOTS.is_empty()) };
    for (kernel, dot) in DOTS {
        let loops = loops_of_products(&text, kernel);
        assert!(!loops.is_empty(), "{kernel}: no loops");
        for (name, code) in loops {
            let is_one = |line: &&Line| line.1.contains(dot) || !is_product(line);
            let split: Vec<_> = code.iter().filter(|line| !is_one(line)).collect();
            assert!(split.is_empty(), "{name} multiplies by {split:#x?}");
        }
    }
}

#[test]
fn no_inner_loop_spills() {
    let Some(text) = disassembly() else {
        return;
    };
    let mut loops_with_products = 0;
    let mut spilling = Vec::new();
    for kernel in KERNELS {
        // Of the largest loop: its products, and all of its instructions.
        let mut most = (0, 0);
        let before = loops_with_products;
        for (name, inner) in loops_of_products(&text, kernel) {
            loops_with_products += 1;
            let products = inner.iter().filter(|l| is_product(l)).count();
            most = most.max((products, inner.len()));
            let spills: Vec<_> = inner.iter().filter(|l| is_on_stack(l)).collect();
            if !spills.is_empty() {
                spilling.push(format!("{name}: {spills:#x?}"));
            }
        }
        println!("{kernel}: {} products of {} instructions", most.0, most.1);
        let seen = loops_with_products - before;
        assert!(seen >= LEAST_LOOPS, "{kernel}: {seen} loops");
    }
    assert!(
        spilling.is_empty(),
        "of {loops_with_products} inner loops these keep a vector on the stack: {}",
        spilling.join("\n")
    );
    println!("{loops_with_products} inner loops of products, none with a vector on the stack");
}
