//! Named f32 arrays go in, the bytes of a NumPy `.npz` file come out (zip without compression, format 1.0 of `.npy`).

/// One array, row-major.
pub(super) struct Array<'a> {
    pub name: &'a str,
    pub shape: &'a [usize],
    pub data: &'a [f32],
}

/// The bytes of an archive of `arrays`, each below 4 GiB.
pub(super) fn npz(arrays: &[Array<'_>]) -> Vec<u8> {
    let mut file = Vec::new();
    let mut directory = Vec::new();
    for array in arrays {
        let body = npy(array);
        let name = format!("{}.npy", array.name);
        let offset = file.len() as u32;
        let common = entry(&body, &name);
        file.extend(b"PK\x03\x04");
        file.extend(&common);
        file.extend(name.as_bytes());
        file.extend(&body);
        directory.extend(b"PK\x01\x02\x14\x00");
        directory.extend(&common);
        directory.extend([0; 10]); // no comment, disk 0, no attributes
        directory.extend(offset.to_le_bytes());
        directory.extend(name.as_bytes());
    }
    let (count, at) = (arrays.len() as u16, file.len() as u32);
    let length = directory.len() as u32;
    file.extend(directory);
    file.extend(b"PK\x05\x06\0\0\0\0");
    file.extend(count.to_le_bytes());
    file.extend(count.to_le_bytes());
    file.extend(length.to_le_bytes());
    file.extend(at.to_le_bytes());
    file.extend([0; 2]);
    file
}

/// The fields that a local header and a directory entry have in common, from "version needed" to "extra length".
fn entry(body: &[u8], name: &str) -> Vec<u8> {
    let size = body.len() as u32;
    let mut e = Vec::new();
    e.extend(20u16.to_le_bytes()); // version
    e.extend([0; 4]); // flags, stored
    e.extend([0, 0, 0x21, 0]); // 1980-01-01: the same arrays give the same bytes
    e.extend(crc32(body).to_le_bytes());
    e.extend(size.to_le_bytes());
    e.extend(size.to_le_bytes());
    e.extend((name.len() as u16).to_le_bytes());
    e.extend([0; 2]);
    e
}

fn npy(array: &Array<'_>) -> Vec<u8> {
    let sides: Vec<String> = array.shape.iter().map(|n| format!("{n},")).collect();
    let mut header = format!(
        "{{'descr': '<f4', 'fortran_order': False, 'shape': ({}), }}",
        sides.join(" ")
    );
    // Data begins at a multiple of 64: 10 bytes of magic and length, the header, a newline.
    let padded = (10 + header.len() + 1).next_multiple_of(64) - 10 - 1;
    header.extend(std::iter::repeat_n(' ', padded - header.len()));
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(array.data.iter().flat_map(|x| x.to_le_bytes()));
    bytes
}

/// CRC-32 of zip (reflected polynomial 0xEDB88320), a nibble at a time: these files are small.
fn crc32(bytes: &[u8]) -> u32 {
    let table: [u32; 16] =
        std::array::from_fn(|i| (0..4).fold(i as u32, |c, _| (c >> 1) ^ (0xEDB8_8320 * (c & 1))));
    let nibble = |c: u32, n: u32| (c >> 4) ^ table[((c ^ n) & 15) as usize];
    let byte = |c, &b: &u8| nibble(nibble(c, u32::from(b)), u32::from(b) >> 4);
    !bytes.iter().fold(!0, byte)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn checksum_of_the_standard_example() {
        assert_eq!(crc32(b"123456789"), 0xCBF4_3926);
    }

    #[test]
    fn arrays_begin_aligned_and_end_in_a_directory() {
        let data = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        let array = Array {
            name: "a",
            shape: &[2, 3],
            data: &data,
        };
        let npy = npy(&array);
        assert_eq!(npy.len() % 64, 4 * data.len() % 64);
        assert!(String::from_utf8_lossy(&npy).contains("'shape': (2, 3,)"));
        let npz = npz(&[array]);
        let end = npz.len() - 22;
        assert_eq!(&npz[end..end + 4], b"PK\x05\x06");
        let at = u32::from_le_bytes(npz[end + 16..end + 20].try_into().unwrap()) as usize;
        assert_eq!(&npz[at..at + 4], b"PK\x01\x02");
    }
}
