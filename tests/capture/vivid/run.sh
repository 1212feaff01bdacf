#!/usr/bin/env bash
# Runs the real camera code against the kernel's virtual camera `vivid` in an emulated machine: pictures, unplugging, a driver
# that fails, a second instance, what `edgecap doctor` says. About five minutes; prints what happened, checks nothing by itself.
#
# Debian: apt-get install --no-install-recommends qemu-system-x86 busybox-static v4l-utils cpio kmod
# Usage: cargo build --release --bins --example camera_probe && tests/capture/vivid/run.sh
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
build=${1:-$here/../../../target/release}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"

version=$(apt-cache depends linux-image-amd64 | sed -n 's/.*linux-image-\([0-9].*\)$/\1/p')
apt-get download "linux-image-$version"
dpkg -x linux-image-*.deb kernel
depmod -b kernel "$version"

# The first file system: busybox, the modules in the order of their dependencies, and init.
mkdir -p root/bin root/proc root/sys root/dev root/tmp root/mnt share
cp "$(command -v busybox)" root/bin/busybox
for name in sh mount insmod echo cat ls poweroff sleep grep kill mkdir tail; do ln -s busybox "root/bin/$name"; done
cp "$here/init" root/init
chmod +x root/init
modprobe -d kernel -S "$version" --show-depends -a virtio_pci 9p 9pnet_virtio vivid |
    sed -n 's/^insmod \([^ ]*\).*/\1/p' | awk '!seen[$0]++' | while read -r module; do
        cp "$module" "root/$(basename "$module")"
        echo "/$(basename "$module")"
    done > root/modules
(cd root && find . | cpio -o -H newc --quiet | gzip -1) > initrd.gz

# What the machine sees under /mnt: the probe, the program, v4l2-ctl and their libraries.
cp "$build/examples/camera_probe" "$build/edgecap" share/
cp "$(command -v v4l2-ctl)" "$here/guest.sh" share/
for library in $(ldd share/camera_probe share/edgecap share/v4l2-ctl | grep -o '/[^ ]*\.so[^ ]*' | sort -u); do cp -L "$library" share/; done

timeout "${PATIENCE:-900}" qemu-system-x86_64 -kernel "kernel/boot/vmlinuz-$version" -initrd initrd.gz \
    -append "console=ttyS0 quiet panic=-1" -nographic -no-reboot -m 768 -smp 1 -cpu max \
    -virtfs local,path=share,mount_tag=host,security_model=none < /dev/null | stdbuf -o0 tr -d '\r' | grep --line-buffered -v schedule_timeout
