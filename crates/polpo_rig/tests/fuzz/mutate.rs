//! Ways to spoil a file.

/// What one mutation does, by numbers that are taken for whatever it needs.
pub(crate) type Mutation = (u8, u32, u32, u32);

/// Numbers that are hard on readers.
const WORDS: [&str; 16] = [
    "4294967295",
    "4294967296",
    "-1",
    "0",
    "18446744073709551615",
    "1e39",
    "nan",
    "inf",
    "-0",
    "1",
    "255",
    "999999999",
    "2147483648",
    "[[[[[[",
    "{}",
    "\"\\ud800\"",
];
const BYTES: [[u8; 4]; 6] = [[255; 4], [0; 4], [0, 0, 192, 127], [0, 0, 128, 255], [255, 255, 255, 127], [127, 255, 255, 255]];

/// The file with the mutations done to it one after the other; `other` is a file to splice from.
pub(crate) fn mutated(file: &[u8], other: &[u8], mutations: &[Mutation]) -> Vec<u8> {
    let mut bytes = file.to_vec();
    for &(kind, a, b, c) in mutations {
        let within = |n: u32, len: usize| if len == 0 { 0 } else { n as usize % len };
        let at = within(a, bytes.len());
        let end = (at + within(b, 64)).min(bytes.len());
        match kind % 10 {
            0 if !bytes.is_empty() => bytes[at] ^= 1 << (b % 8),
            1 if !bytes.is_empty() => bytes[at] = b as u8,
            2 => bytes.truncate(at),
            3 => drop(bytes.drain(at..end)),
            4 => {
                let piece = bytes[at..end].to_vec();
                let to = within(c, bytes.len() + 1);
                bytes.splice(to..to, piece);
            }
            5 => {
                let from = within(b, other.len());
                let piece = &other[from..(from + within(c, 200)).min(other.len())];
                bytes.splice(at..end, piece.iter().copied());
            }
            6 if bytes.len() >= at + 4 => bytes[at..at + 4].copy_from_slice(&BYTES[within(b, BYTES.len())]),
            // A number or word of the text becomes another.
            7 | 8 => {
                let in_word = |x: &u8| x.is_ascii_alphanumeric() || b".-+".contains(x);
                let start = at + bytes[at..].iter().position(in_word).unwrap_or(bytes.len() - at);
                let len = bytes[start..].iter().position(|x| !in_word(x)).unwrap_or(bytes.len() - start);
                bytes.splice(start..start + len, WORDS[within(b, WORDS.len())].bytes());
            }
            // A piece many times over.
            9 => {
                let piece = bytes[at..end].repeat(within(c, 300));
                bytes.splice(at..at, piece);
            }
            _ => {}
        }
    }
    bytes
}
