/* Dynamics of the robot ${robot}, by sst-pin compile --export-c. SI units, radians.
 *
 * q[${nq}]: ${q_names}
 * va[${n}], aa[${n}]: rates and accelerations of ${coordinates}
 * tau[${motors}]: ${motor_names}
 *
 * An array for the result may be one of the arguments. Compile without -ffast-math. */
#ifndef ROBOT_H
#define ROBOT_H

#ifdef __cplusplus
extern "C" {
#endif

/* What each function returns: 0, or why its result means nothing. */
enum {
    ROBOT_OPEN = 1, /* the loops are open by more than $closed */
    ROBOT_SINGULAR, /* the coordinates do not fix the motion, or the motors do not hold it, or
                     * nearly so; or the ends of a line coincide */
    ROBOT_NOT_FINITE, /* a number is not finite, or an angle beyond $angle */
    ROBOT_LIMITS /* no torques within the limits make the motion, or it was not found; or a cable
                  would push */
};

/* Gravity, masses, inertias, friction, springs, rotors, lines; robot.c says which is which. They
 * may be changed between calls. */
extern ${type} robot_parameters[${parameters}];

${functions}
#ifdef __cplusplus
}
#endif

#endif
