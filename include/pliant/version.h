/** @file version.h
 *  Which version this is, when compiling and when running, and what the library exports.
 */
#ifndef PLIANT_VERSION_H
#define PLIANT_VERSION_H

/** Of these headers. While the major version is 0, any minor one may change the interface. */
#define PLIANT_VERSION_MAJOR 0
#define PLIANT_VERSION_MINOR 1
#define PLIANT_VERSION_PATCH 0
#define PLIANT_VERSION "0.1.0"

/** Before every function that the library exports; all others are hidden. */
#if defined(__GNUC__)
#define PLIANT_API __attribute__((visibility("default")))
#else
#define PLIANT_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

/** PLIANT_VERSION of the library that runs, which may be newer than the headers that a program was compiled with. Static. */
PLIANT_API const char *pliant_version(void);

#ifdef __cplusplus
}
#endif
#endif
