#!/bin/bash
# Training on a GPU that is lent for minutes, by calls that carry little: a process of its own goes on between the calls.
#   gpu.sh take RUN PART                 a part of carry.py into RUN/parts; RUN is a folder that outlives the call
#   gpu.sh train RUN PARTS OPTION...     in the background, on two parts first, on all PARTS once they are there, until the time in
#                                        RUN/end (seconds since 1970, read at both starts); OPTIONs are train.py's. Its
#                                        schedule ends with the time. With --steps it counts those, and training may
#                                        stop at that time before its end
#   gpu.sh watch RUN BACK                checkpoints to BACK, which is fetched after the call, until training has ended
set -eu
what=$1 run=$2
here=$(cd "$(dirname "$0")" && pwd)
mkdir -p "$run/parts"

# At depth 0 lies the folder of parts, whose own name fits as well.
arrived() { find "$run/parts" -mindepth 1 -maxdepth 1 -name 'part*' | wc -l; }

unpack() { # to a folder in RUN
    python3 "$here/carry.py" unpack "$run/parts" "$run/$1"
}

go() { # on a folder in RUN
    local data=$run/$1 minutes
    shift
    minutes=$(awk -v end="$(cat "$run/end")" -v now="$(date +%s)" 'BEGIN { print (end - now) / 60 }')
    exec python3 "$here/train.py" "$data/pack" "$run" --everyday "$data/everyday" --scenes "$data"/scenes/* \
        --total "$minutes" --minutes "$minutes" --save-every 45 "$@"
}

train() {
    local parts=$1 first=
    shift
    while [ "$(arrived)" -lt $((parts < 2 ? parts : 2)) ]; do sleep 1; done
    # With all of them here there is nothing to begin on earlier, and who is ended before training began leaves nothing to resume.
    if [ "$parts" -gt 2 ] && [ "$(arrived)" -lt "$parts" ]; then
        unpack some
        (go some "$@") &
        first=$!
        while [ "$(arrived)" -lt "$parts" ]; do sleep 1; done
    fi
    unpack all
    if [ "$first" ]; then
        kill -TERM "$first"
        wait "$first"
        set -- "$@" --resume
    fi
    # A schedule of steps cannot be bent to the time.
    case " $* " in
    *' --steps '* | *' --steps='*) ;;
    *) set -- --finish "$@" ;;
    esac
    (go all "$@")
}

case $what in
take)
    name=$(basename "$3")
    cp -r "$3" "$run/parts/.$name"
    mv "$run/parts/.$name" "$run/parts/$name"
    ;;
train)
    shift 2
    rm -f "$run/ended"
    export -f arrived unpack go train
    export run here
    setsid nohup bash -c 'set -eu; trap "echo \$? >\"\$run/ended\"" EXIT; train "$@"' train "$@" >>"$run/train.log" 2>&1 </dev/null &
    ;;
watch)
    back=$3
    mkdir -p "$back"
    until [ -e "$run/ended" ]; do
        for _ in 1 2 3 4 5 6; do [ -e "$run/ended" ] || sleep 5; done
        cp "$run"/ckpt/*.pt "$run/log.jsonl" "$run/train.log" "$back" 2>/dev/null || true
    done
    # Training that failed early has left no checkpoint: its log says why.
    ended=$(cat "$run/ended") copied=0
    cp "$run"/ckpt/*.pt "$run/log.jsonl" "$run/train.log" "$back" || copied=$?
    tail -n 20 "$run/train.log"
    exit $((ended ? ended : copied))
    ;;
*)
    echo "expected take, train or watch, found $what" >&2
    exit 2
    ;;
esac
