//! The layers of axioms: what an axiom needs to be false is derived in an earlier layer (Thiébaux, Hoffmann and
//! Nebel 2005, "In defense of PDDL axioms"); and when a derived fact may become false in the relaxed task.

use super::super::task::{Fact, Task};
use super::refusal::Refusal;

/// Gives the axioms layers and an order, and makes the relaxed rules.
pub(super) fn order(task: &mut Task) -> Result<(), Refusal> {
    let layers = layers(task)?;
    for axiom in &mut task.axioms {
        axiom.layer = layers[task.variables[axiom.fact as usize] as usize];
    }
    task.axioms.sort_by_key(|axiom| axiom.layer);
    relax(task);
    Ok(())
}

/// The smallest layer of each variable.
fn layers(task: &Task) -> Result<Vec<u32>, Refusal> {
    let mut layers = vec![0; task.len()];
    let most = task.is_derived.iter().filter(|is_derived| **is_derived).count() as u32;
    let mut uses: Vec<Vec<u32>> = vec![Vec::new(); task.len()];
    for (number, axiom) in task.axioms.iter().enumerate() {
        for fact in axiom.condition.iter().filter(|fact| task.is_derived[task.variable(**fact)]) {
            uses[task.variable(*fact)].push(number as u32);
        }
    }
    let mut queue: Vec<u32> = (0..task.axioms.len() as u32).collect();
    while let Some(number) = queue.pop() {
        let axiom = &task.axioms[number as usize];
        let needed = axiom.condition.iter().filter(|fact| task.is_derived[task.variable(**fact)]).map(|fact| {
            let variable = task.variable(*fact);
            layers[variable] + u32::from(*fact == task.offsets[variable])
        });
        let (needed, head) = (needed.max().unwrap_or(0), task.variable(axiom.fact));
        if needed > most {
            return Err(Refusal::Circular);
        }
        if needed > layers[head] {
            layers[head] = needed;
            queue.extend(&uses[head]);
        }
    }
    Ok(layers)
}

/// A derived fact may become false where each of its axioms has a condition that may. Where it depends on itself,
/// it is taken to be false for nothing.
fn relax(task: &mut Task) {
    let mut is_wanted = vec![false; task.len()];
    let mut queue: Vec<usize> = Vec::new();
    let conditions = task.operators.iter().flat_map(|operator| {
        operator.condition.iter().chain(operator.effects.iter().flat_map(|effect| &effect.condition))
    });
    let conditions = conditions.chain(task.axioms.iter().flat_map(|axiom| &axiom.condition)).chain(&task.goal);
    for fact in conditions {
        let variable = task.variable(*fact);
        if task.is_derived[variable]
            && *fact == task.offsets[variable]
            && !std::mem::replace(&mut is_wanted[variable], true)
        {
            queue.push(variable);
        }
    }
    let is_cyclic = cyclic(task);
    let mut by_head: Vec<Vec<usize>> = vec![Vec::new(); task.len()];
    for (number, axiom) in task.axioms.iter().enumerate() {
        by_head[task.variable(axiom.fact)].push(number);
    }
    let mut rules: Vec<(Vec<Fact>, Fact)> = Vec::new();
    let mut next = task.relaxed_facts as Fact;
    while let Some(variable) = queue.pop() {
        let negation = task.offsets[variable];
        if is_cyclic[variable] {
            rules.push((Vec::new(), negation));
            continue;
        }
        let mut broken = Vec::new();
        for axiom in by_head[variable].iter().map(|number| &task.axioms[*number]) {
            broken.push(next);
            for fact in &axiom.condition {
                let other = task.variable(*fact);
                rules.extend(task.domain(other).filter(|value| value != fact).map(|value| (vec![value], next)));
                let is_first = task.is_derived[other] && *fact != task.offsets[other];
                if is_first && !std::mem::replace(&mut is_wanted[other], true) {
                    queue.push(other);
                }
            }
            next += 1;
        }
        rules.push((broken, negation));
    }
    task.relaxed = rules;
    task.relaxed_facts = next as usize;
}

/// Which derived variables depend on themselves, or on such variables: those that no order leaves out.
fn cyclic(task: &Task) -> Vec<bool> {
    let mut open = vec![0_u32; task.len()];
    let mut uses: Vec<Vec<u32>> = vec![Vec::new(); task.len()];
    for axiom in &task.axioms {
        let head = task.variable(axiom.fact);
        for fact in axiom.condition.iter().filter(|fact| task.is_derived[task.variable(**fact)]) {
            open[head] += 1;
            uses[task.variable(*fact)].push(head as u32);
        }
    }
    let mut queue: Vec<usize> = (0..task.len()).filter(|variable| open[*variable] == 0).collect();
    while let Some(variable) = queue.pop() {
        for head in &uses[variable] {
            open[*head as usize] -= 1;
            if open[*head as usize] == 0 {
                queue.push(*head as usize);
            }
        }
    }
    open.iter().map(|count| *count > 0).collect()
}
