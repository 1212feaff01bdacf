//! Files that are given for a record and hold something else: what to say of them.

use super::kind::Kind;
use super::rows::{ObservationsRow, Row};

/// What a record of this kind is called.
pub fn expected(kind: u8) -> &'static str {
    match kind == ObservationsRow::KIND {
        true => "observations",
        false => "bodies",
    }
}

/// What a record of the other kind is, and what to do; `None` where it is none.
pub fn kind(wanted: u8, found: Kind) -> Option<&'static str> {
    match (wanted == ObservationsRow::KIND, found) {
        (true, Kind::Bodies) => Some(
            "bodies; 'edgecap infer --jsonl' and 'edgecap record --observations' write observations",
        ),
        (false, Kind::Observations) => {
            Some("observations; 'edgecap fit --input … --record FILE' makes bodies of them")
        }
        _ => None,
    }
}

/// What a film or picture is where a record is wanted, and what to do.
pub fn film(wanted: u8) -> &'static str {
    match wanted == ObservationsRow::KIND {
        true => "a film or picture; 'edgecap infer --input … --record FILE' makes a record of it",
        false => "a film or picture; 'edgecap run --input … --record FILE' makes a record of it",
    }
}

/// Whether a file that begins so is a film or a picture.
pub fn is_film(head: &[u8]) -> bool {
    let starts: [&[u8]; 9] = [
        b"RIFF",
        b"YUV4MPEG2",
        b"\x1A\x45\xDF\xA3",
        b"\xFF\xD8\xFF",
        b"\x89PNG",
        b"FLV",
        b"OggS",
        b"GIF8",
        b"\x00\x00\x01\xBA",
    ];
    head.get(4..8) == Some(b"ftyp") || starts.iter().any(|start| head.starts_with(start))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::BodyFrame;
    use crate::record::{BodiesRow, RowReader};

    #[test]
    fn what_is_no_such_record_is_told_in_both_formats() {
        let bodies = serde_json::to_vec(&BodiesRow::new(
            &BodyFrame {
                fit_us: 1,
                ..BodyFrame::default()
            },
            "",
        ))
        .unwrap();
        fn read<T: Row + std::fmt::Debug>(bytes: &[u8]) -> String {
            let read = RowReader::<_, T>::new(bytes, "file").read();
            read.map(|_| ()).unwrap_err().to_string()
        }
        // A line without people is one of both kinds.
        let mut with_people = serde_json::from_slice::<serde_json::Value>(&bodies).unwrap();
        with_people["people"] = serde_json::json!([{ "id": 1 }]);
        let with_people = serde_json::to_vec(&with_people).unwrap();
        for bytes in [&with_people[..], b"EDGECAPB"] {
            let said = read::<ObservationsRow>(bytes);
            assert!(
                said.contains("expected observations, found bodies"),
                "{said}"
            );
        }
        let said = read::<BodiesRow>(b"EDGECAPO");
        assert!(said.contains("found observations; 'edgecap fit"), "{said}");
        let program_stream = &b"\x00\x00\x01\xBA\x44"[..];
        let films = [
            b"RIFF....AVI ",
            &b"....ftypisom"[..],
            b"FLV\x01",
            b"OggS\0",
            b"GIF89a",
            program_stream,
        ];
        for bytes in films {
            assert!(read::<BodiesRow>(bytes).contains("'edgecap run --input"));
            assert!(read::<ObservationsRow>(bytes).contains("'edgecap infer --input"));
        }
    }
}
