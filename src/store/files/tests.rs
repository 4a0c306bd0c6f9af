//! The file store against crashes, faults and damage, on a disk that is made for it.

mod crash;
mod damage;
mod doctor;
mod fault;
mod faulty;
mod golden;
mod reading;
mod record;
mod rules;
mod script;
mod sealed;
