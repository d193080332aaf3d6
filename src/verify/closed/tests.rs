use super::*;

fn found(schema: &Schema, json: &str) -> Vec<String> {
    let found = schema.walk(json.as_bytes()).unwrap();
    found
        .into_iter()
        .map(|(path, what)| format!("{path}: {what}"))
        .collect()
}

#[test]
fn what_a_schema_does_not_name_is_found_wherever_it_is() {
    let shard = r#"{"z": 1, "tiles": [{"path": "p", "grid": [0, 0, 1], "box": {"min": [0, 0, 0],
        "max": [1, 1, 1]}, "vertices": 3, "triangles": 1, "strips": 1, "indices": 3, "bytes": 9,
        "checksum": "c", "groups": [{"cell": 1, "object": 1, "surface": 1, "vertices": 3, "triangles": 1}]}]}"#;
    assert!(found(&SHARD, shard).is_empty());
    for (from, to, at) in [
        (
            r#""z": 1,"#,
            r#""z": 1, "more": {"z": 1},"#,
            ": found a member \"more\"",
        ),
        (
            r#""z": 1,"#,
            r#""z": 1, "z": 1,"#,
            "/z: the member is there twice",
        ),
        (r#""z": 1,"#, "", ": found no member \"z\""),
        (
            r#""z": 1,"#,
            r#""z": "1","#,
            "/z: found a value of type string",
        ),
        (
            r#""min": [0,"#,
            r#""min": [true,"#,
            "/tiles/0/box/min/0: found a value of type boolean",
        ),
        (
            r#""cell": 1,"#,
            r#""cell": 1, "cell": 2,"#,
            "/tiles/0/groups/0/cell: the member is there twice",
        ),
        (
            r#""cell": 1,"#,
            r#""cell": 1.5,"#,
            "/tiles/0/groups/0/cell: found a value of type number",
        ),
        (
            r#""bytes": 9"#,
            r#""bytes": 9, "byte\u0073": 9"#,
            "/tiles/0/bytes: the member is there twice",
        ),
    ] {
        let changed = shard.replacen(from, to, 1);
        let all = found(&SHARD, &changed);
        assert!(all.len() == 1 && all[0].starts_with(at), "{to}: {all:?}");
    }
    assert!(SHARD.walk(b"{\"z\": 1").is_err());
}

/// Values have types, also where the schema states none.
#[test]
fn a_value_in_a_list_is_not_the_value() {
    for (schema, at, value) in [
        (&TILES[0], "scene", "[0]"),
        (&TILES[1], "scene", "{\"scene\": 0}"),
        (&*MANIFEST, "lattice", "[256]"),
        (&*MANIFEST, "encoding", "[\"float\"]"),
    ] {
        let all = found(schema, &format!("{{\"{at}\": {value}}}"));
        let wrong = format!("/{at}: found a value of type");
        assert!(all.iter().any(|f| f.starts_with(&wrong)), "{all:?}");
    }
}

#[test]
fn all_schemas_are_read() {
    assert!(MANIFEST.shapes.len() > 40);
    for tile in TILES.iter() {
        let constants = tile.shapes.iter().filter(|s| s.values.len() == 1);
        assert!(constants.count() > 5);
    }
    let empty = found(&TILES[1], "{}");
    assert!(
        empty
            .iter()
            .any(|f| f == ": found no member \"extensions\""),
        "{empty:?}"
    );
}
