//! schema.

use crate::lab::{Lab, assert_run, kitchen};

#[test]
fn a_schema_describes_each_field() {
    let lab = Lab::new();
    let fields = kitchen(&lab, &["schema", "robmem.worldmodel", "{type: 'object'}"]).success();
    let mass = fields.lines().find(|line| line.contains("\"field\":\"mass\"")).unwrap();
    assert_eq!(
        mass,
        "{\"field\":\"mass\",\"documents\":2,\"share\":1.0,\"types\":{\"double\":2},\"distinct\":1,\"least\":0.25,\
         \"greatest\":0.25,\"frequent\":[{\"value\":0.25,\"count\":2}]}"
    );
    assert_run!(kitchen(&lab, &["schema", "robmem.worldmodel", "{type: 'object'}", "--format", "table"]), @r#"
    field                         documents  share  types        distinct  least      greatest   frequent
    _id                           2          1.0    {string: 2}  2         blue-cup   red-cup
    type                          2          1.0    {string: 2}  1         object     object     [{value: "object", count: 2}]
    name                          2          1.0    {string: 2}  2         blue-cup   red-cup
    location                      2          1.0    {string: 2}  1         table      table      [{value: "table", count: 2}]
    storage_place                 2          1.0    {string: 2}  2         counter    table
    frame                         2          1.0    {string: 2}  1         table-top  table-top  [{value: "table-top", count: 2}]
    translation                   2          1.0    {array: 2}
    rotation                      2          1.0    {array: 2}
    geometry                      2          1.0    {object: 2}
    geometry.type                 2          1.0    {string: 2}  1         cylinder   cylinder   [{value: "cylinder", count: 2}]
    geometry.radius               2          1.0    {double: 2}  1         0.04       0.04       [{value: 0.04, count: 2}]
    geometry.length               2          1.0    {double: 2}  1         0.1        0.1        [{value: 0.1, count: 2}]
    color                         2          1.0    {array: 2}
    mass                          2          1.0    {double: 2}  1         0.25       0.25       [{value: 0.25, count: 2}]
    subframes                     1          0.5    {object: 1}
    subframes.handle              1          0.5    {object: 1}
    subframes.handle.translation  1          0.5    {array: 1}
    ------- stderr -------
    2 documents of robmem.worldmodel
    [exit code: 0]
    "#);
}

#[test]
fn a_collection_that_is_missing_is_said() {
    let lab = Lab::new();
    lab.rmem(&["insert", "robmem.orders", "{_id: 1}"]).success();
    assert_run!(lab.rmem(&["schema", "robmem.order"]), @r"
    ------- stderr -------
    0 documents of robmem.order
    warning: no collection robmem.order; did you mean robmem.orders?
    [exit code: 0]
    ");
    let empty = lab.rmem(&["schema", "robmem.orders", "{_id: 2}"]);
    assert_eq!((empty.code, empty.stderr.as_str()), (0, "0 documents of robmem.orders\n"), "{empty}");
}
