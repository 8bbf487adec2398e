//! The values of derived variables: the fixpoint of the axioms, layer by layer.

use super::task::{Fact, Task};

/// Computes the values of derived variables.
#[derive(Debug, Clone, Default)]
pub(super) struct Axioms {
    /// The axioms in whose conditions a fact is.
    uses: Vec<Vec<u32>>,
    /// How many facts each axiom needs.
    needs: Vec<u32>,
    open: Vec<u32>,
    derived: Vec<u32>,
    /// The axioms of each layer, from the first.
    layers: Vec<std::ops::Range<usize>>,
    queue: Vec<Fact>,
}

impl Axioms {
    pub(super) fn new(task: &Task) -> Self {
        let derived = (0..task.len() as u32).filter(|variable| task.is_derived[*variable as usize]).collect();
        let mut axioms = Self { derived, ..Self::default() };
        if task.axioms.is_empty() {
            return axioms;
        }
        axioms.uses = vec![Vec::new(); task.facts()];
        for (number, axiom) in task.axioms.iter().enumerate() {
            axiom.condition.iter().for_each(|fact| axioms.uses[*fact as usize].push(number as u32));
            axioms.needs.push(axiom.condition.len() as u32);
        }
        let mut start = 0;
        for layer in task.axioms.chunk_by(|a, b| a.layer == b.layer) {
            axioms.layers.push(start..start + layer.len());
            start += layer.len();
        }
        axioms
    }

    /// Sets the derived variables of a state to what follows from the others.
    pub(super) fn derive(&mut self, task: &Task, state: &mut [Fact]) {
        if self.derived.is_empty() {
            return;
        }
        for variable in &self.derived {
            state[*variable as usize] = task.offsets[*variable as usize];
        }
        self.open.clone_from(&self.needs);
        for range in self.layers.clone() {
            self.layer(task, state, range);
        }
    }

    fn layer(&mut self, task: &Task, state: &mut [Fact], range: std::ops::Range<usize>) {
        for number in range.clone() {
            let axiom = &task.axioms[number];
            self.open[number] =
                axiom.condition.iter().filter(|fact| state[task.variable(**fact)] != **fact).count() as u32;
        }
        for number in range.clone().filter(|number| self.open[*number] == 0).collect::<Vec<_>>() {
            self.set(task, state, task.axioms[number].fact);
        }
        while let Some(fact) = self.queue.pop() {
            for place in 0..self.uses[fact as usize].len() {
                let number = self.uses[fact as usize][place] as usize;
                // Earlier layers are done, and later ones look at the state when it is their turn.
                if !range.contains(&number) {
                    continue;
                }
                self.open[number] -= 1;
                if self.open[number] == 0 {
                    self.set(task, state, task.axioms[number].fact);
                }
            }
        }
    }

    fn set(&mut self, task: &Task, state: &mut [Fact], fact: Fact) {
        let variable = task.variable(fact);
        if state[variable] != fact {
            state[variable] = fact;
            self.queue.push(fact);
        }
    }
}
