// The program around a session: it runs jobs beside the session's own work, and tells the time.
#pragma once

#include <chrono>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <stop_token>
#include <utility>

#include "base/error.h"
#include "base/fetched_source.h"
#include "base/interruption.h"

namespace splatvol {

/// A job that a host has begun. Its end is waited for at its destruction.
class Job {
 public:
  virtual ~Job() = default;

  /// Waits for the end up to a time. Returns whether the job has ended.
  [[nodiscard]] virtual bool wait(double seconds) const = 0;
};

/// Runs jobs on other threads, or on that of the call. Tells the time.
class SessionHost {
 public:
  enum class Priority {
    usual,
    low,  // gives way to what draws the window
  };

  virtual ~SessionHost() = default;

  /// Begins a job. `work` returns whether it has ended; else it is to be called again when bytes have come
  /// (ErrorCode::pending). Where no thread starts, it has ended on return.
  [[nodiscard]] virtual std::unique_ptr<Job> begin(std::function<bool()> work, Priority priority) = 0;

  /// Returns the seconds since some beginning. Thread-safe.
  [[nodiscard]] virtual double now() const = 0;
};

/// A host without threads, for files whose reads wait: each job runs at once.
class InlineHost : public SessionHost {
 public:
  [[nodiscard]] std::unique_ptr<Job> begin(std::function<bool()> work, Priority /*priority*/) override {
    struct Ended final : Job {
      [[nodiscard]] bool wait(double /*seconds*/) const override { return true; }
    };
    while (!work()) {
    }
    return std::make_unique<Ended>();
  }
  [[nodiscard]] double now() const override {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
  }
};

/// A job with a result, which heeds an interruption (base/interruption.h). At first there is none. A result that is
/// pending is none: the work is done again, and the bytes that it has read stay until its end.
template <class Value>
class Task {
 public:
  Task() = default;
  template <class Work>
  Task(SessionHost& host, Work work, SessionHost::Priority priority = SessionHost::Priority::usual)
      : stop_(std::stop_source()),
        value_(std::make_shared<std::optional<Value>>()),
        job_(host.begin(
            [value = value_, work = std::move(work), stop = stop_.get_token(),
             bytes = std::make_shared<FetchedBytes>()]() mutable {
              const Interruptible interruptible(stop);
              const FetchedBytes::Scope scope(bytes.get());
              Value made = work();
              if constexpr (requires { is_pending(made); })
                if (is_pending(made) && !stop.stop_requested()) return false;
              value->emplace(std::move(made));
              return true;
            },
            priority)) {}

  /// Whether there is a job whose result has not been taken.
  [[nodiscard]] bool is_begun() const { return job_ != nullptr; }

  /// Whether it has ended, at the latest after some seconds. Requires is_begun().
  [[nodiscard]] bool wait(double seconds = 0) const { return job_->wait(seconds); }

  /// Asks the job to end early: its result tells whether it did.
  void interrupt() { stop_.request_stop(); }

  /// Ends the job, if there is one, without its result.
  void end() {
    interrupt();
    if (is_begun()) static_cast<void>(take());
  }

  /// Waits for the result. Requires is_begun().
  [[nodiscard]] Value take() {
    static_cast<void>(job_->wait(std::numeric_limits<double>::infinity()));
    job_.reset();
    return std::move(**std::exchange(value_, nullptr));
  }

 private:
  std::stop_source stop_{std::nostopstate};
  std::shared_ptr<std::optional<Value>> value_;
  std::unique_ptr<Job> job_;
};

}  // namespace splatvol
