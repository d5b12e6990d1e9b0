// Call services from threads. An exception that leaves a thread would end rviz.
#ifndef PLIANT_RVIZ_SERVICE_H
#define PLIANT_RVIZ_SERVICE_H

#include <ros/exception.h>
#include <ros/service.h>

#include <string>

namespace pliant_rviz {

// Return false if the service does not answer or the name is invalid.
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
