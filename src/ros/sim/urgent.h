/* What answers a hand waits for nobody: threads of real time, where the system lets this user have them, and what others do meanwhile.
 *
 * Of roscpp's own locks none inherits a priority. An ordinary thread that is put aside while it holds one (every publication of the process
 * goes through one, until the message is serialized) holds up the answers for as long as the machine has other things to do: 1 to 5 ms in one
 * of a hundred on two cores with a load of 17. So ordinary threads publish ahead of all others but those that answer. */
#ifndef PLIANT_ROS_SIM_URGENT_H
#define PLIANT_ROS_SIM_URGENT_H

#include <pthread.h>

#include <atomic>

namespace pliant_ros {

/* among real-time threads; what publishes serializes and compresses meanwhile, which no answer waits for */
enum { URGENT_PRIORITY = 10, PUBLISHING_PRIORITY = URGENT_PRIORITY - 1 };

/* False where this user may not. */
inline bool make_urgent(pthread_t thread, int among = URGENT_PRIORITY)
{
    sched_param priority{};
    priority.sched_priority = among;
    return pthread_setschedparam(thread, SCHED_FIFO, &priority) == 0;
}

/* Whether anything in this process answers a hand, by a thread of real time. */
inline std::atomic<bool> &answers_hands()
{
    static std::atomic<bool> on{false};
    return on;
}

/* While it lives, this thread publishes: it is next to the urgent ones, if answers_hands. */
class Urgent {
public:
    Urgent() : raised_(answers_hands() && pthread_getschedparam(pthread_self(), &kind_, &before_) == 0 && kind_ == SCHED_OTHER && make_urgent(pthread_self(), PUBLISHING_PRIORITY)) {}
    ~Urgent()
    {
        if (raised_) pthread_setschedparam(pthread_self(), kind_, &before_);
    }
    Urgent(const Urgent &) = delete;

private:
    int kind_ = SCHED_OTHER;
    sched_param before_{};
    const bool raised_;
};

template <class Publisher, class Message> void publish_urgently(const Publisher &publisher, const Message &message)
{
    const Urgent urgent;
    publisher.publish(message);
}

/* Whoever holds it gets on as fast as the most urgent thread that waits for it. */
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
