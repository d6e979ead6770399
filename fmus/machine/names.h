/* In place of common/names.h: functions of a machine have plain names and are not exported. */
#ifndef EIGHTPOST_NAMES_H
#define EIGHTPOST_NAMES_H
#endif
