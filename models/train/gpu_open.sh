#!/bin/bash
# The open model on a GPU, in two calls of ten minutes: gpu_open.sh 1|2 PART RUN BACK MINUTES
#   PART  a part that carry.py packed (part0 for call 1, part1 for call 2)   RUN  a folder that outlives the call
#   BACK  the folder that is fetched after it                               MINUTES  for training; getting ready takes one more
set -eu
call=$1 part=$2 run=$3 back=$4 minutes=$5
here=$(cd "$(dirname "$0")" && pwd)
mkdir -p "$run/parts" "$back"
case $call in
1) length=(--total 10) ;;
2) length=(--resume --finish) ;;
*) echo "expected 1 or 2, found $call" >&2 && exit 2 ;;
esac
cp -r "$part" "$run/parts/"
data=$run/data$call
python3 "$here/carry.py" unpack "$run/parts" "$data"
# what is there comes back, also where the call is cut off
(while sleep 30; do cp "$run"/ckpt/*.pt "$run/log.jsonl" "$back" 2>/dev/null || true; done) &
trap "kill $!" EXIT
python3 "$here/train.py" "$run/none" "$run" --open --everyday "$data/everyday" --scenes "$data"/scenes/* \
    --lr 3e-3 --muon --peak 9 4 --synth 0.6 --w3d 0.5 --ema 0.999 --fall 0.4 --groups native \
    "${length[@]}" --minutes "$minutes" --save-every 45 >"$back/train.log" 2>&1
cp "$run"/ckpt/*.pt "$run/log.jsonl" "$back"
tail -n 20 "$back/train.log"
