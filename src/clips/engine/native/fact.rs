//! Facts: asserted, changed, retracted and read.

use clips_sys as sys;

use super::environment::Environment;
use super::handle::FactRef;
use super::text::{c_text, text};
use super::value::Value;

impl Environment {
    /// Asserts a fact that is spelled out; where CLIPS cannot, it has printed why. The same fact
    /// as one that is there is that one.
    pub(crate) fn assert_text(&self, text: &str) -> Option<FactRef> {
        // SAFETY: the environment is alive, and the text is copied.
        let fact = unsafe { sys::AssertString(self.raw(), c_text(text).as_ptr()) };
        // SAFETY: it has just been asserted.
        (!fact.is_null()).then(|| unsafe { FactRef::new(fact, self.alive()) })
    }

    /// Asserts an ordered fact of a template that rules mention; returns whether they do.
    pub(crate) fn assert_mentioned(&self, template: &str, values: &[Value]) -> bool {
        // SAFETY: the environment is alive; the values are copied into the fact, which CLIPS owns once it is asserted.
        unsafe {
            let found = sys::FindDeftemplate(self.raw(), c_text(template).as_ptr());
            if found.is_null() || !sys::DeftemplatePPForm(found).is_null() {
                return false;
            }
            let fact = sys::CreateFact(found);
            let mut native = self.to_native(&Value::Many(values.to_vec()));
            let is_put = !fact.is_null() && sys::PutFactSlot(fact, std::ptr::null(), &raw mut native);
            is_put && !sys::Assert(fact).is_null()
        }
    }

    /// Asserts a fact with slots; slots that are not given have their defaults.
    ///
    /// # Errors
    /// What does not fit the template, as a sentence.
    pub(crate) fn assert(&self, template: &str, slots: &[(String, Value)]) -> Result<FactRef, String> {
        self.build(template, slots, None)
    }

    /// Changes some slots; returns the fact as it is then, which is another one. CLIPS 6.40 would do that
    /// itself, but frees the values of a multislot that it has just put there.
    ///
    /// # Errors
    /// What does not fit the template, or that the fact is gone, as a sentence.
    pub(crate) fn modify(&self, fact: &FactRef, changes: &[(String, Value)]) -> Result<FactRef, String> {
        if !self.exists(fact) {
            return Err("the fact is gone".to_owned());
        }
        let mut slots = self.slots(fact);
        for (name, value) in changes {
            match slots.iter_mut().find(|(slot, _)| slot == name) {
                Some(slot) => slot.1 = value.clone(),
                None => return Err(format!("`{name}` is not a slot of the fact")),
            }
        }
        self.build(&self.template_of(fact), &slots, Some(fact))
    }

    /// Asserts a fact, in place of another one; where it does not fit, that one stays.
    fn build(&self, template: &str, slots: &[(String, Value)], old: Option<&FactRef>) -> Result<FactRef, String> {
        // SAFETY: the environment is alive; the builder is used for one fact and disposed of.
        unsafe {
            let builder = sys::CreateFactBuilder(self.raw(), c_text(template).as_ptr());
            if builder.is_null() {
                return Err(format!("there is no deftemplate `{template}`"));
            }
            let wrong = slots.iter().find_map(|(name, value)| {
                let mut native = self.to_native(value);
                complaint(sys::FBPutSlot(builder, c_text(name).as_ptr(), &raw mut native), template, name)
            });
            let fact = match wrong {
                None => {
                    if let Some(old) = old {
                        self.retract(old);
                    }
                    sys::FBAssert(builder)
                }
                Some(_) => std::ptr::null_mut(),
            };
            let asserted = (!fact.is_null()).then(|| FactRef::new(fact, self.alive()));
            sys::FBDispose(builder);
            asserted.ok_or_else(|| wrong.unwrap_or_else(|| format!("CLIPS does not assert this `{template}`")))
        }
    }

    /// Retracts a fact; returns whether it was there.
    pub(crate) fn retract(&self, fact: &FactRef) -> bool {
        let Some(pointer) = fact.pointer(self.alive()).filter(|_| self.exists(fact)) else { return false };
        // SAFETY: the environment is alive and the fact there.
        unsafe { sys::Retract(pointer) == sys::RetractError_RE_NO_ERROR }
    }

    /// Whether the fact is there.
    pub(crate) fn exists(&self, fact: &FactRef) -> bool {
        // SAFETY: a fact that is known is retained, so that its memory is.
        fact.pointer(self.alive()).is_some_and(|pointer| unsafe { sys::FactExistp(pointer) })
    }

    /// The name of the fact's template, without its module.
    pub(crate) fn template_of(&self, fact: &FactRef) -> String {
        let Some(pointer) = fact.pointer(self.alive()) else { return String::new() };
        // SAFETY: the fact's memory is kept, and the template's while it has facts in use.
        unsafe { text(sys::DeftemplateName(sys::FactDeftemplate(pointer))) }
    }

    /// The values of an ordered fact; none where the fact has slots.
    pub(crate) fn ordered(&self, fact: &FactRef) -> Option<Vec<Value>> {
        let pointer = fact.pointer(self.alive())?;
        let mut native = sys::CLIPSValue::default();
        // SAFETY: the fact's memory is kept; without a slot's name only ordered facts answer.
        unsafe {
            let got = sys::GetFactSlot(pointer, std::ptr::null(), &raw mut native);
            if got != sys::GetSlotError_GSE_NO_ERROR {
                return None;
            }
            match self.value(native.__bindgen_anon_1.header) {
                Value::Many(values) => Some(values),
                _ => None,
            }
        }
    }

    /// The slots of a fact with their values; those with several have a [`Value::Many`].
    pub(crate) fn slots(&self, fact: &FactRef) -> Vec<(String, Value)> {
        let Some(pointer) = fact.pointer(self.alive()) else { return Vec::new() };
        let mut names = sys::CLIPSValue::default();
        // SAFETY: the fact's memory is kept, and the template's while it has facts in use.
        unsafe {
            sys::DeftemplateSlotNames(sys::FactDeftemplate(pointer), &raw mut names);
            let Value::Many(names) = self.value(names.__bindgen_anon_1.header) else { return Vec::new() };
            let slot = |name: Value| {
                let Value::Symbol(name) = name else { return None };
                let mut native = sys::CLIPSValue::default();
                let got = sys::GetFactSlot(pointer, c_text(&name).as_ptr(), &raw mut native);
                (got == sys::GetSlotError_GSE_NO_ERROR).then(|| (name, self.value(native.__bindgen_anon_1.header)))
            };
            names.into_iter().filter_map(slot).collect()
        }
    }

    /// The facts of a template, the oldest first.
    pub(crate) fn facts_of(&self, template: &str) -> Vec<FactRef> {
        let mut facts = Vec::new();
        // SAFETY: the environment is alive, and no fact comes or goes meanwhile.
        unsafe {
            let template = sys::FindDeftemplate(self.raw(), c_text(template).as_ptr());
            if template.is_null() {
                return facts;
            }
            let mut next = sys::GetNextFactInTemplate(template, std::ptr::null_mut());
            while !next.is_null() {
                facts.push(FactRef::new(next, self.alive()));
                next = sys::GetNextFactInTemplate(template, next);
            }
        }
        facts
    }

    /// The names of all templates whose facts have slots.
    pub(crate) fn templates(&self) -> Vec<String> {
        let mut names = Vec::new();
        // SAFETY: the environment is alive, and no template comes or goes meanwhile.
        unsafe {
            let mut next = sys::GetNextDeftemplate(self.raw(), std::ptr::null_mut());
            while !next.is_null() {
                if !sys::DeftemplatePPForm(next).is_null() {
                    names.push(text(sys::DeftemplateName(next)));
                }
                next = sys::GetNextDeftemplate(self.raw(), next);
            }
        }
        names
    }

    /// The `deftemplate` of that name, as CLIPS prints it; none where it has only ordered
    /// facts, or is not there.
    pub(crate) fn template(&self, name: &str) -> Option<String> {
        // SAFETY: the environment is alive; the form is copied.
        unsafe {
            let template = sys::FindDeftemplate(self.raw(), c_text(name).as_ptr());
            let form = (!template.is_null()).then(|| sys::DeftemplatePPForm(template))?;
            (!form.is_null()).then(|| text(form))
        }
    }
}

/// What is wrong with a value for a slot.
fn complaint(error: sys::PutSlotError, template: &str, slot: &str) -> Option<String> {
    let what = match error {
        sys::PutSlotError_PSE_NO_ERROR => return None,
        sys::PutSlotError_PSE_SLOT_NOT_FOUND_ERROR => return Some(format!("`{slot}` is not a slot of `{template}`")),
        sys::PutSlotError_PSE_TYPE_ERROR => "its value is of a type that the slot does not take",
        sys::PutSlotError_PSE_RANGE_ERROR => "its value is out of the slot's range",
        sys::PutSlotError_PSE_ALLOWED_VALUES_ERROR => "its value is none of the slot's allowed values",
        sys::PutSlotError_PSE_CARDINALITY_ERROR => "it has too few or too many values",
        _ => "its value does not fit",
    };
    Some(format!("the slot `{slot}` of `{template}`: {what}"))
}
