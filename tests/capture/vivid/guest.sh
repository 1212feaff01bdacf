# Runs inside the emulated machine.
linked="/mnt/ld-linux-x86-64.so.2 --library-path /mnt"
probe="$linked /mnt/camera_probe"
control="$linked /mnt/v4l2-ctl -d /dev/video0"

echo "--- five pictures"
$probe /dev/video0 5
echo "ends with $?"

echo "--- a second instance; another program; after SIGKILL of the first"
$probe /dev/video0 200 > /tmp/first 2>&1 &
first=$!
sleep 3
$probe /dev/video0 2
echo "ends with $? (75: in use)"
mkdir -p /tmp/elsewhere
XDG_RUNTIME_DIR=/tmp/elsewhere $probe /dev/video0 2
echo "ends with $? (75: in use)"
kill -9 $first
sleep 1
$probe /dev/video0 2
echo "ends with $?"

for trouble in disconnect inject_fatal_streaming_error inject_v4l2_buf_flag_error; do
    echo "--- $trouble while pictures come"
    $probe /dev/video0 120 > /tmp/log 2>&1 &
    sleep 4
    $control -c $trouble=1
    wait $!
    echo "ends with $?"
    grep -B2 -A2 waiting /tmp/log
    tail -n 1 /tmp/log
done

echo "--- unplugged for five seconds"
$probe /dev/video0 120 > /tmp/log 2>&1 &
sleep 4
echo vivid.0 > /sys/bus/platform/drivers/vivid/unbind
sleep 5
echo vivid.0 > /sys/bus/platform/drivers/vivid/bind
wait $!
echo "ends with $?"
grep -B2 -A2 waiting /tmp/log
tail -n 1 /tmp/log

echo "--- no picture arrives for eight seconds"
$control -c percentage_of_dropped_buffers=100
$probe /dev/video0 5 > /tmp/log 2>&1 &
sleep 8
$control -c percentage_of_dropped_buffers=0
wait $!
echo "ends with $?"
cat /tmp/log

for wrap in wrap_sequence_number wrap_timestamp; do
    echo "--- $wrap: the driver's counter starts anew while pictures come"
    $control -c $wrap=1
    $probe /dev/video0 200 > /tmp/log 2>&1
    echo "ends with $?"
    grep waiting /tmp/log
    grep -c 'after the last' /tmp/log
    tail -n 3 /tmp/log
    $control -c $wrap=0
done

echo "--- starting fails once"
for trouble in reqbufs qbuf streamon; do
    $control -c inject_vidioc_${trouble}_error=1
    $probe /dev/video0 3
    echo "ends with $? (69: unavailable)"
done

echo "--- no such camera"
$probe /dev/video7 1
echo "ends with $? (69: unavailable)"

echo "--- what doctor says of a camera that works, and of one that gives no pictures"
mkdir -p /dev/shm
mount -t tmpfs shm /dev/shm
$linked /mnt/edgecap doctor
echo "ends with $?"
$control -c percentage_of_dropped_buffers=100
$linked /mnt/edgecap doctor
echo "ends with $? (69: unavailable)"
