//! The file store against crashes, faults and damage, on a disk that is made for it.

mod changes;
mod crash;
mod damage;
mod doctor;
mod fault;
mod faulty;
mod folders;
mod golden;
mod healing;
mod reading;
mod record;
mod restart;
mod rules;
mod script;
mod sealed;
mod unreadable;
