// Calls of services by threads that nothing may leave: an exception there would end rviz.
#ifndef PLIANT_RVIZ_SERVICE_H
#define PLIANT_RVIZ_SERVICE_H

#include <ros/exception.h>
#include <ros/service.h>

#include <string>

namespace pliant_rviz {

// False where nobody answers, and where a person typed what is no name.
template <class Service> bool call_service(const std::string &name, Service *service)
{
    try {
        return ros::service::call(name, *service);
    } catch (const ros::Exception &) {
        return false;
    }
}

} // namespace pliant_rviz

#endif
