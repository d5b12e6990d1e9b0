/** @file version.h
 *  Version of the headers and of the library, and the mark of exported functions.
 */
#ifndef PLIANT_VERSION_H
#define PLIANT_VERSION_H

/** Version of these headers. While the major version is 0, any minor version may change the interface. */
#define PLIANT_VERSION_MAJOR 0
#define PLIANT_VERSION_MINOR 1
#define PLIANT_VERSION_PATCH 0
#define PLIANT_VERSION "0.1.0"

/** Mark of every function that the library exports. All other functions are hidden. */
#if defined(__GNUC__)
#define PLIANT_API __attribute__((visibility("default")))
#else
#define PLIANT_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

/** Return the version of the loaded library, which may be newer than the headers of the compiled program.
 *  @return Text such as PLIANT_VERSION, static. */
PLIANT_API const char *pliant_version(void);

#ifdef __cplusplus
}
#endif
#endif
