#!/bin/bash
# One call of a short GPU lease (ten minutes at most): gpu.sh 1|2|3 PACK RUN BACK
#   PACK  what pack.py made (50 MiB)     RUN  a folder that outlives the call     BACK  the folder that is fetched after it
# Calls 1 and 2 train, call 3 anneals, trains Stage II on true outputs, measures and exports.  Twenty-five minutes from random weights.
set -eu
call=$1 pack=$2 run=$3 back=$4
here=$(cd "$(dirname "$0")" && pwd)
mkdir -p "$run" "$back"
keep() { cp "$run/ckpt/ema.pt" "$run/log.jsonl" "$back"; }
case $call in
1)
    python3 "$here/scenes.py" "$pack" "$back/sheet.jpg" --n 12 --bench 256
    python3 "$here/train.py" "$pack" "$run" --total 24 --minutes 8.3
    keep
    ;;
2)
    [ -e "$run/ckpt" ] || { mkdir -p "$run/ckpt" && cp "$back/ema.pt" "$run/ckpt/"; } # the machine was lost: go on from the averages
    python3 "$here/train.py" "$pack" "$run" --total 24 --minutes 9.3 --resume
    keep
    ;;
3)
    python3 "$here/train.py" "$pack" "$run" --minutes 4.5 --resume --finish
    python3 "$here/stage2.py" "$pack" "$run" --minutes 2.5 --batch 4096 --lr 4e-3 --stage1 "$run/ckpt"
    python3 "$here/export.py" "$run"
    cp "$run"/*.safetensors "$run/stage2.pt" "$run/log.jsonl" "$back"
    python3 "$here/prerender.py" "$pack" "$run/held" --n 256 --held --seed 99991 --threads 16
    python3 "$here/evaluate.py" "$pack" "$run" --scenes "$run/held"
    cp "$run/eval.json" "$back"
    ;;
*)
    echo "expected 1, 2 or 3, found $call" >&2
    exit 2
    ;;
esac
