/* Real-time priorities for threads that compute forces for a hand, if the system permits them.
 *
 * roscpp's locks do not inherit priorities. Every publication of the process passes through one lock until its message
 * is serialized. An ordinary thread that is preempted while it holds the lock delays the forces. The measured delay is
 * 1 to 5 ms for one force in a hundred, on two cores with a load of 17. Ordinary threads therefore publish with a
 * priority just below the force threads. */
#ifndef PLIANT_ROS_SIM_REALTIME_PRIORITY_H
#define PLIANT_ROS_SIM_REALTIME_PRIORITY_H

#include <pthread.h>

#include <atomic>

namespace pliant_ros {

/* real-time priorities; a publishing thread serializes and compresses meanwhile, which no force waits for */
enum { URGENT_PRIORITY = 10, PUBLISHING_PRIORITY = URGENT_PRIORITY - 1 };

/* Return false if the user has no permission. */
inline bool set_realtime_priority(pthread_t thread, int among = URGENT_PRIORITY)
{
    sched_param priority{};
    priority.sched_priority = among;
    return pthread_setschedparam(thread, SCHED_FIFO, &priority) == 0;
}

/* Return whether a real-time thread of this process computes forces. */
inline std::atomic<bool> &computes_hand_forces()
{
    static std::atomic<bool> on{false};
    return on;
}

/* While an object of this class exists, the thread has the publishing priority, if computes_hand_forces. */
class PublishingPriority {
public:
    PublishingPriority()
        : raised_(computes_hand_forces() && pthread_getschedparam(pthread_self(), &kind_, &before_) == 0 &&
                  kind_ == SCHED_OTHER && set_realtime_priority(pthread_self(), PUBLISHING_PRIORITY))
    {
    }
    ~PublishingPriority()
    {
        if (raised_) pthread_setschedparam(pthread_self(), kind_, &before_);
    }
    PublishingPriority(const PublishingPriority &) = delete;

private:
    int kind_ = SCHED_OTHER;
    sched_param before_{};
    const bool raised_;
};

template <class Publisher, class Message> void publish_with_priority(const Publisher &publisher, const Message &message)
{
    const PublishingPriority urgent;
    publisher.publish(message);
}

/* Mutex with priority inheritance: its owner runs with the priority of the most urgent waiting thread. */
class InheritingMutex {
public:
    InheritingMutex()
    {
        pthread_mutexattr_t kind;
        pthread_mutexattr_init(&kind);
        pthread_mutexattr_setprotocol(&kind, PTHREAD_PRIO_INHERIT);
        pthread_mutex_init(&mutex_, &kind);
        pthread_mutexattr_destroy(&kind);
    }
    ~InheritingMutex() { pthread_mutex_destroy(&mutex_); }
    InheritingMutex(const InheritingMutex &) = delete;
    void lock() { pthread_mutex_lock(&mutex_); }
    void unlock() { pthread_mutex_unlock(&mutex_); }

private:
    pthread_mutex_t mutex_;
};

} // namespace pliant_ros

#endif
