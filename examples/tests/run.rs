//! The examples run as they stand and find what they say.

#[path = "../01_one_call.rs"]
mod one_call;
#[path = "../03_own_policy.rs"]
mod own_policy;
#[path = "../02_stage_by_stage.rs"]
mod stage_by_stage;

// One test: the street is simulated once.
#[test]
fn each_depth_finds_the_robot() {
    one_call::main().unwrap();
    stage_by_stage::main().unwrap();
    own_policy::main().unwrap();
}
