// What became of loop closures.

/** `ConstraintKind`. */
const LOOP_CLOSURE = 2;

/** "accepted", "provisional" or "off" of a loop closure; null of any other constraint. */
export function verdictOf({ case: kind, value }) {
  if (kind !== "relativePose" || value.kind !== LOOP_CLOSURE) return null;
  if (!value.switchedOff) return "accepted";
  return value.switchedOff.provisional ? "provisional" : "off";
}

/** Why a constraint is switched off, for people. */
export function reasonOf({ chi2, weight, provisional }) {
  const numbers = `χ² ${chi2.toPrecision(3)}, weight ${weight.toPrecision(2)}`;
  return provisional
    ? `no other closure joins its places and the odometry speaks against it (${numbers})`
    : `it does not fit what other closures and the odometry say (${numbers})`;
}
