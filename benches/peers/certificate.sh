#!/bin/sh
# Everything that the README says about speed, in one go of about five minutes on an idle machine:
#   certificate.sh OUT [--pictures DIR] [--weights NETWORK=FILE]
# Model files are made first, then the machine is measured: the certificate, the comparison, and the comparison without VNNI.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
out=$1
shift
mkdir -p "$out"
"$here/run.sh" --prepare "$@"
(cd "$here/../.." && cargo build --quiet --release --bin edgecap)
# The load of the preparation must be over, or everything is marked as disturbed.
sleep 90
"$here/../../target/release/edgecap" bench --seconds 2 --layers --save "$out/certificate.json" >"$out/certificate.txt"
"$here/run.sh" --rounds 6 --out "$out" "$@"
if grep -q avx512_vnni /proc/cpuinfo; then
    "$here/run.sh" --isa avx512 --rounds 4 --out "$out/avx512-without-vnni" "$@"
fi
head -32 "$out/certificate.txt"
