//! What the index says of how a part was chosen, as far as its counts tell.

use crate::manifest::{Selection, Step, Totals};
use crate::table::Table;

/// Checks what a selection says of counts.
pub(super) fn check_selection(
    selection: &Selection,
    t: &Totals,
    wrong: &mut impl FnMut(&str, String),
) {
    let of = selection.of;
    let all = [of.cells, of.objects, of.surfaces, of.voxels_above];
    let own = [t.cells, t.objects, t.surfaces, t.voxels_above];
    let fewer = own.iter().zip(all).all(|(own, all)| *own <= all);
    if selection.steps().any(|step| step.omit && !step.chooses()) {
        let message = "found true, expected false without a condition".to_owned();
        wrong("selection/omit", message);
    }
    let condition = |i: usize| &selection.painted[i].condition;
    let over = |i: &usize| (0..*i).any(|k| condition(k) == condition(*i));
    if let Some(i) = (0..selection.painted.len()).find(over) {
        let message = format!(
            "found {:?} twice, expected each condition once",
            condition(i)
        );
        wrong(&format!("selection/painted/{i}"), message);
    }
    // without a condition all are there, and all objects have all voxels
    let chosen = selection.steps().any(|step| step.chooses()) || own == all;
    let same_objects = own[1] != all[1] || own[3] == all[3];
    if !(fewer && chosen && same_objects) {
        let message = format!("found {all:?} of the whole, and {own:?} of the part");
        wrong("selection/of", message);
    }
    for (i, step) in selection.steps().enumerate() {
        check_largest(selection, i, &step, own, wrong);
    }
}

/// Compares the number of the largest that a step chose with that of the rows that are left, where these tell.
fn check_largest(
    selection: &Selection,
    i: usize,
    step: &Step,
    own: [u64; 4],
    wrong: &mut impl FnMut(&str, String),
) {
    let of = selection.of;
    let (own, all) = match step.table {
        Table::Cells => (own[0], of.cells),
        Table::Objects => (own[1], of.objects),
        Table::Surfaces => (own[2], of.surfaces),
    };
    let Some(n) = step.largest else { return };
    let (first, last) = (i == 0, i == selection.before.len());
    let rest = all.saturating_sub(n);
    let (least, most) = match (step.omit, &step.condition) {
        (false, None) => (n.min(all), n.min(all)),
        (false, Some(_)) => (0, n.min(all)),
        (true, None) => (rest, rest),
        (true, Some(_)) => (rest, all),
    };
    // later steps leave fewer, and earlier ones left fewer to choose from
    let most = if first || !step.omit { most } else { all };
    let least = if first && last { least } else { 0 };
    if !(least..=most).contains(&own) {
        let at = match last {
            true => "selection/largest".to_owned(),
            false => format!("selection/before/{i}/largest"),
        };
        let what = step.table.name();
        wrong(
            &at,
            format!("found {n}, and {own} of {all} {what} in the part"),
        );
    }
}
