//! PLY: ascii, binary little- and big-endian; the element `vertex` with x, y, z among its properties.
//!
//! An own reader: `ply-rs-bw` 4 refuses `nan`, `inf` and `1.` in ascii bodies, comments that are not UTF-8 and property
//! names such as CloudCompare's `scalar_distance[<0.1]`, loops without end over a hostile element without properties,
//! and parses what follows the vertices too. This one stops after the last vertex.

use super::sink::PointSink;
use crate::error::{Error, HINT_INCOMPLETE};
use crate::input::{Input, text, tokens};
use crate::scalar::{Scalar, XyzLayout};

const HINT_HEADER: &str =
    "a PLY header has a format line, 'element vertex N', 'property float x' ... and end_header";

/// Most lines a header may have.
const HEADER_LINES: u64 = 10_000;

#[derive(Clone, Copy, PartialEq)]
enum Format {
    Ascii,
    Little,
    Big,
}

enum Property {
    Scalar(String, Scalar),
    /// Type of the length, type of the entries.
    List(Scalar, Scalar),
}

struct Element {
    name: String,
    count: u64,
    properties: Vec<Property>,
}

pub(super) fn read(mut input: Input, sink: &mut PointSink) -> Result<(), Error> {
    input.refuse_empty()?;
    let (format, elements) = read_header(&mut input)?;
    for element in &elements {
        let is_vertex = element.name == "vertex";
        let axes = is_vertex.then(|| axes(&input, element)).transpose()?;
        if is_vertex {
            sink.reserve(element.count.min(input.remaining() / element.smallest(format)));
        }
        let big_endian = format == Format::Big;
        match (format, element.scalars()) {
            (Format::Ascii, _) => read_ascii(&mut input, element, axes, sink)?,
            (_, Some(scalars)) => read_fixed(&mut input, element, &scalars, axes, big_endian, sink)?,
            (_, None) => read_lists(&mut input, element, axes, big_endian, sink)?,
        }
        if is_vertex {
            return Ok(());
        }
    }
    Err(Error::malformed(&input.path, "header", "there is no element 'vertex'", HINT_HEADER))
}

impl Element {
    /// The types of its properties where none is a list.
    fn scalars(&self) -> Option<Vec<Scalar>> {
        self.properties
            .iter()
            .map(|p| match p {
                Property::Scalar(_, s) => Some(*s),
                Property::List(..) => None,
            })
            .collect()
    }

    /// The fewest bytes one entry can take in the file.
    fn smallest(&self, format: Format) -> u64 {
        let binary = |p: &Property| match p {
            Property::Scalar(_, s) => s.size(),
            Property::List(length, _) => length.size(),
        };
        let bytes: usize = match format {
            Format::Ascii => 2 * self.properties.len(),
            _ => self.properties.iter().map(binary).sum(),
        };
        bytes.max(1) as u64
    }
}

fn read_header(input: &mut Input) -> Result<(Format, Vec<Element>), Error> {
    let mut line = Vec::new();
    if !input.next_line(&mut line)? || line.trim_ascii() != b"ply" {
        let what = "the file does not start with the line 'ply'";
        return Err(Error::malformed(&input.path, "line 1", what, "check that this is a PLY file"));
    }
    let mut format = None;
    let mut elements: Vec<Element> = Vec::new();
    loop {
        if input.line >= HEADER_LINES || !input.next_line(&mut line)? {
            return Err(Error::malformed(&input.path, "header", "no end_header line was found", HINT_HEADER));
        }
        let words: Vec<_> = tokens(&line).map(text).collect();
        let words: Vec<&str> = words.iter().map(AsRef::as_ref).collect();
        match words.as_slice() {
            ["format", "ascii", ..] => format = Some(Format::Ascii),
            ["format", "binary_little_endian", ..] => format = Some(Format::Little),
            ["format", "binary_big_endian", ..] => format = Some(Format::Big),
            ["format", rest @ ..] => {
                let what = format!("format {} is not known", rest.join(" "));
                return Err(
                    input.line_error(what, "known are ascii, binary_little_endian and binary_big_endian")
                );
            }
            ["element", name, count] => {
                let count = count.parse().map_err(|_| {
                    let what = format!("'{count}' is no number of entries for the element {name}");
                    input.line_error(what, HINT_HEADER)
                })?;
                elements.push(Element { name: (*name).to_owned(), count, properties: Vec::new() });
            }
            ["property", "list", length, entry, ..] => {
                let length = scalar(length).filter(|s| !matches!(s, Scalar::F32 | Scalar::F64));
                let (Some(length), Some(entry)) = (length, scalar(entry)) else {
                    return Err(input.line_error("the list has types that are not known", HINT_HEADER));
                };
                add_property(input, &mut elements, Property::List(length, entry))?;
            }
            ["property", kind, name @ ..] if !name.is_empty() => {
                let Some(kind) = scalar(kind) else {
                    return Err(input.line_error(format!("the type '{kind}' is not known"), HINT_HEADER));
                };
                add_property(input, &mut elements, Property::Scalar(name.join(" "), kind))?;
            }
            ["end_header"] => break,
            ["element" | "property", ..] => {
                return Err(input.line_error("the line is not complete", HINT_HEADER));
            }
            // Comments, obj_info and what other writers add.
            _ => {}
        }
    }
    let Some(format) = format else {
        return Err(Error::malformed(&input.path, "header", "the format line is missing", HINT_HEADER));
    };
    if let Some(e) = elements.iter().find(|e| e.properties.is_empty() && e.count > 0) {
        let what = format!("the element {} has {} entries without properties", e.name, e.count);
        return Err(Error::malformed(&input.path, "header", what, HINT_HEADER));
    }
    Ok((format, elements))
}

fn add_property(input: &Input, elements: &mut [Element], property: Property) -> Result<(), Error> {
    match elements.last_mut() {
        Some(element) => element.properties.push(property),
        None => return Err(input.line_error("a property stands before the first element", HINT_HEADER)),
    }
    Ok(())
}

fn scalar(name: &str) -> Option<Scalar> {
    Some(match name {
        "char" | "int8" => Scalar::I8,
        "uchar" | "uint8" => Scalar::U8,
        "short" | "int16" => Scalar::I16,
        "ushort" | "uint16" => Scalar::U16,
        "int" | "int32" => Scalar::I32,
        "uint" | "uint32" => Scalar::U32,
        "int64" => Scalar::I64,
        "uint64" => Scalar::U64,
        "float" | "float32" => Scalar::F32,
        "double" | "float64" => Scalar::F64,
        _ => return None,
    })
}

/// Which properties of the vertex are x, y and z.
fn axes(input: &Input, vertex: &Element) -> Result<[usize; 3], Error> {
    let find = |axis: &str| {
        vertex
            .properties
            .iter()
            .position(|p| matches!(p, Property::Scalar(name, _) if name.eq_ignore_ascii_case(axis)))
    };
    if let (Some(x), Some(y), Some(z)) = (find("x"), find("y"), find("z")) {
        return Ok([x, y, z]);
    }
    let what = "the vertices have no properties x, y and z";
    Err(Error::malformed(&input.path, "header", what, "export the cloud with its coordinates"))
}

fn too_few(input: &Input, element: &Element, place: String, holds: u64) -> Error {
    let what = format!("element {} says {}, the file holds {holds}", element.name, element.count);
    Error::malformed(&input.path, place, what, HINT_INCOMPLETE)
}

fn read_ascii(
    input: &mut Input,
    element: &Element,
    axes: Option<[usize; 3]>,
    sink: &mut PointSink,
) -> Result<(), Error> {
    let mut line = Vec::new();
    let mut done = 0;
    while done < element.count {
        if !input.next_line(&mut line)? {
            return Err(too_few(input, element, format!("line {}", input.line + 1), done));
        }
        let mut words = tokens(&line).peekable();
        if words.peek().is_none() {
            continue;
        }
        // Other elements take one line an entry, whatever stands in it.
        if let Some(axes) = axes {
            let mut point = [f64::NAN; 3];
            for (i, property) in element.properties.iter().enumerate() {
                let short = || {
                    let what = format!("the line has {i} of {} properties", element.properties.len());
                    input.line_error(what, HINT_INCOMPLETE)
                };
                let word = text(words.next().ok_or_else(short)?);
                let axis = axes.iter().position(|&a| a == i);
                let bad =
                    |_| input.line_error(format!("'{word}' stands where a number is expected"), HINT_HEADER);
                match (property, axis) {
                    (Property::List(..), _) => {
                        let length: u64 =
                            word.parse().map_err(|e: std::num::ParseIntError| bad(e.to_string()))?;
                        for _ in 0..length {
                            words.next().ok_or_else(short)?;
                        }
                    }
                    (Property::Scalar(..), Some(axis)) => {
                        point[axis] =
                            word.parse().map_err(|e: std::num::ParseFloatError| bad(e.to_string()))?;
                    }
                    (Property::Scalar(..), None) => {}
                }
            }
            sink.push(point);
        }
        done += 1;
    }
    Ok(())
}

/// An element whose entries all have the same size.
fn read_fixed(
    input: &mut Input,
    element: &Element,
    scalars: &[Scalar],
    axes: Option<[usize; 3]>,
    big_endian: bool,
    sink: &mut PointSink,
) -> Result<(), Error> {
    let size: usize = scalars.iter().map(|s| s.size()).sum();
    let holds = input.remaining() / size.max(1) as u64;
    if holds < element.count {
        return Err(too_few(input, element, format!("byte {}", input.len), holds));
    }
    let offset = |i: usize| scalars[..i].iter().map(|s| s.size()).sum();
    let layout = axes.map(|axes| XyzLayout { fields: axes.map(|i| (offset(i), scalars[i])), big_endian });
    let mut record = vec![0; size];
    for done in 0..element.count {
        if !input.fill(&mut record)? {
            return Err(too_few(input, element, format!("byte {}", input.taken), done));
        }
        if let Some(layout) = &layout {
            sink.push(layout.read(&record));
        }
    }
    Ok(())
}

/// An element with lists: entry by entry, number by number.
fn read_lists(
    input: &mut Input,
    element: &Element,
    axes: Option<[usize; 3]>,
    big_endian: bool,
    sink: &mut PointSink,
) -> Result<(), Error> {
    for done in 0..element.count {
        let mut point = [f64::NAN; 3];
        for (i, property) in element.properties.iter().enumerate() {
            let first = match property {
                Property::Scalar(_, s) | Property::List(s, _) => *s,
            };
            let mut number = [0; 8];
            let number = &mut number[..first.size()];
            if !input.fill(number)? {
                return Err(too_few(input, element, format!("byte {}", input.taken), done));
            }
            let value = first.read(number, 0, big_endian);
            if let Property::List(_, entry) = property {
                // The length type is an integer of at most 8 bytes: in range, or refused here.
                let bytes = value * entry.size() as f64;
                if !(0.0..=input.remaining() as f64).contains(&bytes) {
                    return Err(too_few(input, element, format!("byte {}", input.taken), done));
                }
                skip(input, bytes as u64)?;
            } else if let Some(axis) = axes.and_then(|a| a.iter().position(|&a| a == i)) {
                point[axis] = value;
            }
        }
        if axes.is_some() {
            sink.push(point);
        }
    }
    Ok(())
}

/// Skips bytes that the caller knows to be there.
fn skip(input: &mut Input, bytes: u64) -> Result<(), Error> {
    let step = i64::try_from(bytes).unwrap_or(i64::MAX);
    input.reader.seek_relative(step).map_err(|e| Error::io(&input.path, "reading", e))?;
    input.taken += bytes;
    Ok(())
}
