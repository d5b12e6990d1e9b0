/* Symbols that Pliant's own libraries, nodes, programs and Python module need from libpliant.so, and users do not.
 * They are exported, but their headers are not installed, and they change without notice. test/symbols_test lists
 * them. */
#ifndef PLIANT_BASE_EXPORT_H
#define PLIANT_BASE_EXPORT_H

#include "pliant/version.h"

#define PLIANT_INTERNAL PLIANT_API

#endif
