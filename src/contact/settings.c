#include "contact/settings.h"

pliant_contact_settings pliant_contact_settings_default(void)
{
#define PLIANT_SETTING_VALUE(type, name, value, ...) .name = value,
    return (pliant_contact_settings){PLIANT_CONTACT_SETTING_LIST(PLIANT_SETTING_VALUE)};
#undef PLIANT_SETTING_VALUE
}

pliant_contact_settings pliant_contact_settings_of(const pliant_scene *scene)
{
    pliant_contact_settings settings = pliant_contact_settings_default();
    settings.guard_depth = scene->contact.guard_depth;
    return settings;
}
