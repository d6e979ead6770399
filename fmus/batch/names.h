/* In place of common/names.h: functions of a batch have plain names and are not exported. */
#ifndef EIGHTPOST_NAMES_H
#define EIGHTPOST_NAMES_H

/* No fused multiply-add in the exact mode, so that the bits are those of the FMUs. */
#if defined(__clang__) && !defined(EIGHTPOST_FAST)
#pragma STDC FP_CONTRACT OFF
#endif

#endif
