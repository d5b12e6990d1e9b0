/* The built-in material table as text. */
#ifndef PLIANT_MATERIAL_DEFAULT_TABLE_H
#define PLIANT_MATERIAL_DEFAULT_TABLE_H

extern const char pliant_default_materials[];

#endif
