//! Bytes that nothing uses, in tiles, pictures and directories, and members that hide where they are.

use super::Base::{Merged, Nodes, Part, Quantized, Web};
use super::{Base, Edit, Files, files, glb, texts, tiles};
use alvis::verify::Code;
use serde_json::Value;

/// Makes the buffer as long as its chunk.
fn fit(json: &mut Value, bin: &[u8]) {
    json["buffers"][0]["byteLength"] = bin.len().into();
}

fn number(value: &Value) -> usize {
    value.as_u64().unwrap() as usize
}

/// The first and the last byte behind a view up to the next one.
fn behind(json: &Value, view: usize) -> std::ops::Range<usize> {
    let at = |v: usize, name: &str| number(&json["bufferViews"][v][name]);
    at(view, "byteOffset") + at(view, "byteLength")..at(view + 1, "byteOffset")
}

/// Where the stream of a view ends.
fn stream_end(json: &Value, view: usize) -> usize {
    let stream = &json["bufferViews"][view]["extensions"]["EXT_meshopt_compression"];
    number(&stream["byteOffset"]) + number(&stream["byteLength"])
}

/// The picture of a part's colours, with something else done to it.
fn legend(files: &mut Files, edit: impl FnOnce(&mut Vec<u8>)) {
    edit(files.get_mut("legend.png").unwrap());
}

/// The picture with one pixel of another colour.
fn repainted(png: &mut Vec<u8>) {
    let mut picture = image::load_from_memory(png).unwrap().to_rgb8();
    picture.put_pixel(300, 60, image::Rgb([1, 2, 3]));
    let mut out = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut out, image::ImageFormat::Png).unwrap();
    *png = out.into_inner();
}

fn add(files: &mut Files, name: &str) {
    files.insert(name.into(), b"MZ".to_vec());
}

/// What hides in a set without a change to what it shows.
pub const OF_BYTES: &[(&str, Base, Code, Edit)] = &[
    ("8 bytes behind the parts", Web, Code::GltfUnused, |f| {
        tiles(f, |j, bin| {
            bin.extend([7; 8]);
            fit(j, bin);
        })
    }),
    (
        "4 zeros behind the parts",
        Quantized,
        Code::GltfUnused,
        |f| {
            tiles(f, |j, bin| {
                bin.extend([0; 4]);
                fit(j, bin);
            })
        },
    ),
    (
        "a chunk that is longer than its buffer",
        Nodes,
        Code::GltfAccessor,
        |f| tiles(f, |_, bin| bin.extend([0; 4])),
    ),
    (
        "a buffer that ends before its chunk",
        Nodes,
        Code::GltfUnused,
        |f| {
            tiles(f, |j, bin| {
                let last = j["bufferViews"].as_array_mut().unwrap().last_mut().unwrap();
                last["byteLength"] = (number(&last["byteLength"]) + 2).into();
                bin.extend([0; 4]);
                j["buffers"][0]["byteLength"] = (bin.len() - 2).into();
            })
        },
    ),
    ("bytes between two parts", Nodes, Code::GltfUnused, |f| {
        tiles(f, |j, bin| {
            let at = number(&j["bufferViews"][2]["byteOffset"]);
            bin.splice(at..at, [0; 16]);
            j["bufferViews"][2]["byteOffset"] = (at + 16).into();
            fit(j, bin);
        })
    }),
    ("bytes between two streams", Web, Code::GltfUnused, |f| {
        tiles(f, |j, bin| {
            let stream = &j["bufferViews"][0]["extensions"]["EXT_meshopt_compression"];
            let at = number(&stream["byteLength"]);
            bin.splice(at..at, [0; 16]);
            for view in j["bufferViews"].as_array_mut().unwrap()[1..].iter_mut() {
                let place = match view.pointer_mut("/extensions/EXT_meshopt_compression/byteOffset")
                {
                    Some(place) => place,
                    None => &mut view["byteOffset"],
                };
                *place = (number(place) + 16).into();
            }
            fit(j, bin);
        })
    }),
    ("padding that is not 0", Merged, Code::GltfUnused, |f| {
        tiles(f, |j, bin| {
            let views = j["bufferViews"].as_array().unwrap().len();
            let padding = (0..views - 1).flat_map(|v| behind(j, v));
            padding.for_each(|at| bin[at] = 1);
        })
    }),
    (
        "indices that are padded with others",
        Nodes,
        Code::GltfUnused,
        |f| {
            tiles(f, |j, bin| {
                // of lists with an odd number of indices, and of strips
                let view = number(&j["bufferViews"][2]["byteOffset"]);
                for a in j["accessors"].as_array().unwrap().iter().skip(2).step_by(3) {
                    let end = view + number(&a["byteOffset"]) + 2 * number(&a["count"]);
                    if !end.is_multiple_of(4) {
                        bin[end] = 1;
                    }
                }
            })
        },
    ),
    ("a longer fallback buffer", Web, Code::GltfUnused, |f| {
        tiles(f, |j, _| {
            let length = number(&j["buffers"][1]["byteLength"]);
            j["buffers"][1]["byteLength"] = (length + 4).into();
        })
    }),
    ("a gap in the fallback buffer", Web, Code::GltfUnused, |f| {
        tiles(f, |j, _| {
            for name in [
                "/bufferViews/1/byteOffset",
                "/bufferViews/2/byteOffset",
                "/bufferViews/3/byteOffset",
                "/buffers/1/byteLength",
            ] {
                let value = j.pointer_mut(name).unwrap();
                *value = (number(value) + 4).into();
            }
        })
    }),
    (
        "a fourth component of positions",
        Quantized,
        Code::GltfUnused,
        |f| tiles(f, |_, bin| bin[6] = 1),
    ),
    (
        "a fourth component of normals",
        Quantized,
        Code::GltfUnused,
        |f| {
            tiles(f, |j, bin| {
                bin[number(&j["bufferViews"][1]["byteOffset"]) + 3] = 1
            })
        },
    ),
    ("blanks in the JSON", Nodes, Code::GltfUnused, |f| {
        texts(f, "\"mode\":", "\"mode\": ")
    }),
    ("a line in the JSON", Merged, Code::GltfUnused, |f| {
        texts(f, "\"scene\":0,", "\"scene\":0\n,")
    }),
    ("a line before the JSON", Web, Code::GltfUnused, |f| {
        texts(f, "{", "\n{")
    }),
    ("tabs behind the JSON", Nodes, Code::GltfUnused, |f| {
        files(f, |json, bin| {
            let json = std::str::from_utf8(json).unwrap().trim_end();
            glb(format!("{json}\t\t"), bin)
        })
    }),
    (
        "64 KiB of blanks behind the JSON",
        Web,
        Code::GltfUnused,
        |f| {
            files(f, |json, bin| {
                let json = std::str::from_utf8(json).unwrap();
                glb(json.to_owned() + &" ".repeat(1 << 16), bin)
            })
        },
    ),
    ("an escape in the JSON", Nodes, Code::GltfUnused, |f| {
        texts(f, "\"mode\":", "\"mod\\u0065\":")
    }),
    (
        "an empty list of extensions",
        Nodes,
        Code::ForeignMember,
        |f| tiles(f, |j, _| j["extensionsUsed"] = serde_json::json!([])),
    ),
    (
        "a grey that is hardly another",
        Nodes,
        Code::GltfUnused,
        |f| {
            tiles(f, |j, _| {
                j["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"][1] =
                    0.800_000_1.into();
            })
        },
    ),
    ("positions of minus 0", Nodes, Code::GltfUnused, |f| {
        tiles(f, |j, bin| {
            let end = number(&j["bufferViews"][0]["byteLength"]);
            let zero = bin[..end]
                .as_chunks_mut::<4>()
                .0
                .iter_mut()
                .find(|p| **p == [0; 4]);
            if let Some(zero) = zero {
                zero[3] = 0x80;
            }
        })
    }),
    ("a row of minus 0", Merged, Code::GltfUnused, |f| {
        tiles(f, |j, bin| {
            bin[number(&j["bufferViews"][3]["byteOffset"]) + 3] = 0x80
        })
    }),
    ("entries behind a strip", Nodes, Code::GltfUnused, |f| {
        tiles(f, |j, bin| {
            // the last piece's indices end the chunk
            let accessor = j["accessors"].as_array_mut().unwrap().last_mut().unwrap();
            let count = number(&accessor["count"]);
            accessor["count"] = (count + 2).into();
            let start = number(&accessor["byteOffset"]);
            let view = &mut j["bufferViews"][2];
            let last = number(&view["byteOffset"]) + start + 2 * count;
            let index = [bin[last - 2], bin[last - 1]];
            bin.truncate(last);
            bin.extend([index, index].concat());
            bin.resize(bin.len().next_multiple_of(4), 0);
            view["byteLength"] = (bin.len() - number(&view["byteOffset"])).into();
            fit(j, bin);
        })
    }),
    (
        "a chunk that claims to be a fallback",
        Web,
        Code::GltfUnused,
        |f| {
            tiles(f, |j, _| {
                j["buffers"][0]["extensions"] = j["buffers"][1]["extensions"].clone();
            })
        },
    ),
    ("extensions in another order", Web, Code::GltfUnused, |f| {
        tiles(f, |j, _| {
            j["extensionsUsed"].as_array_mut().unwrap().reverse()
        })
    }),
    (
        "bytes before the first vertex of a stream",
        Web,
        Code::GltfUnused,
        |f| {
            tiles(f, |j, bin| {
                let at = stream_end(j, 0) - 32;
                bin[at] = 7;
            })
        },
    ),
    (
        "bytes at the end of a stream of indices",
        Web,
        Code::GltfUnused,
        |f| {
            tiles(f, |j, bin| {
                let at = stream_end(j, 2) - 1;
                bin[at] = 7;
            })
        },
    ),
    (
        "a program beside the index",
        Nodes,
        Code::ForeignFile,
        |f| add(f, "evil.exe"),
    ),
    ("a fourth table", Web, Code::ForeignFile, |f| {
        add(f, "volumes.csv")
    }),
    ("a second legend", Part, Code::ForeignFile, |f| {
        add(f, "legend2.png")
    }),
    (
        "a legend of a set without colours",
        Merged,
        Code::ForeignFile,
        |f| add(f, "legend.png"),
    ),
    ("a directory of pictures", Nodes, Code::ForeignFile, |f| {
        add(f, "textures/a.png")
    }),
    ("a file beside the shards", Nodes, Code::ForeignFile, |f| {
        add(f, "index/z0000.bin")
    }),
    ("a file beside the layers", Nodes, Code::ForeignFile, |f| {
        add(f, "tiles/tileset.json")
    }),
    ("a file beside the tiles", Web, Code::ForeignFile, |f| {
        add(f, "tiles/z0000/a.ktx2")
    }),
    ("a legend that is no picture", Part, Code::Paint, |f| {
        legend(f, |png| *png = b"MZ".to_vec())
    }),
    ("a legend that is empty", Part, Code::Paint, |f| {
        legend(f, Vec::clear)
    }),
    ("a legend that is cut", Part, Code::Paint, |f| {
        legend(f, |png| png.truncate(png.len() / 2))
    }),
    ("a legend with bytes behind it", Part, Code::Paint, |f| {
        legend(f, |png| png.extend(b"MZ"))
    }),
    (
        "a legend with a pixel of another colour",
        Part,
        Code::Paint,
        |f| legend(f, repainted),
    ),
    ("an SVG legend of other colours", Part, Code::Paint, |f| {
        f.get_mut("legend.svg").unwrap().extend(b"<!-- -->")
    }),
    ("a legend with a text in it", Part, Code::Paint, |f| {
        legend(f, |png| {
            let text = [
                &[0, 0, 0, 3][..],
                b"tEXta\0b",
                &crc32fast::hash(b"tEXta\0b").to_be_bytes(),
            ];
            png.splice(33..33, text.concat());
        })
    }),
];
