//! completions.

use crate::lab::{Lab, assert_run};

#[test]
fn the_script_for_bash_is_a_script_that_completes_commands() {
    let lab = Lab::empty();
    let line = "rmem completions bash > script && bash -n script && . ./script && \
                COMP_WORDS=(rmem ins) COMP_CWORD=1 && _rmem rmem ins rmem && echo \"${COMPREPLY[@]}\"";
    assert_eq!(lab.shell(line).success(), "insert\n");
}

#[test]
fn every_shell_that_is_offered_has_a_script() {
    for shell in ["bash", "elvish", "fish", "powershell", "zsh"] {
        let script = Lab::empty().rmem(&["completions", shell]).success();
        assert!(script.contains("gen-problem"), "{shell}");
    }
    assert_run!(Lab::empty().rmem(&["completions", "csh"]), @r"
    ------- stderr -------
    error: invalid value 'csh' for '<SHELL>'
      [possible values: bash, elvish, fish, powershell, zsh]

      tip: a similar value exists: 'zsh'

    For more information, try '--help'.
    [exit code: 2]
    ");
}
