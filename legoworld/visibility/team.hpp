// A team of threads that walk through the same phases, and memory that only grows.
#pragma once
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <mutex>
#include <new>
#include <system_error>
#include <thread>
#include <type_traits>
#include <vector>

namespace lw {

// Runs body(worker) on every worker and lets them meet at barriers. Where the system starts fewer threads
// than were asked for, the team is smaller: the result is the same.
class Team {
 public:
  explicit Team(int wanted) {
    others_.reserve(static_cast<size_t>(wanted < 1 ? 0 : wanted - 1));
    try {
      for (int worker = 1; worker < wanted; ++worker) {
        others_.emplace_back([this, worker] { serve(worker); });
      }
    } catch (const std::system_error&) {  // no more threads
    } catch (const std::bad_alloc&) {
    }
    size_ = static_cast<int>(others_.size()) + 1;
  }
  Team(const Team&) = delete;
  Team& operator=(const Team&) = delete;
  ~Team() {
    begin(nullptr, nullptr);
    for (std::thread& other : others_) other.join();
  }

  int size() const { return size_; }
  bool failed() const { return failed_.load(std::memory_order_relaxed); }

  // Once in a team's life.
  template <class Body>
  void run(Body&& body) {
    begin([](void* what, int worker) { (*static_cast<std::remove_reference_t<Body>*>(what))(worker); },
          &body);
    body(0);
    for (std::thread& other : others_) other.join();
    others_.clear();
  }

  // One phase: a worker that runs out of memory must still reach the barrier.
  template <class Work>
  void phase(Work&& work) {
    if (!failed()) {
      try {
        work();
      } catch (const std::bad_alloc&) {
        failed_.store(true);
      }
    }
    meet();
  }

 private:
  typedef void (*Call)(void* body, int worker);

  void begin(Call call, void* body) {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      begun_ = true;
      call_ = call;
      body_ = body;
    }
    all_begin_.notify_all();
  }

  void serve(int worker) {
    {
      std::unique_lock<std::mutex> lock(mutex_);
      all_begin_.wait(lock, [this] { return begun_; });
    }
    if (call_ != nullptr) call_(body_, worker);
  }

  void meet() {
    if (size_ == 1) return;
    std::unique_lock<std::mutex> lock(mutex_);
    const int64_t generation = generation_;
    if (++waiting_ == size_) {
      waiting_ = 0;
      ++generation_;
      all_here_.notify_all();
      return;
    }
    all_here_.wait(lock, [&] { return generation != generation_; });
  }

  std::mutex mutex_;
  std::condition_variable all_begin_, all_here_;
  bool begun_ = false;
  Call call_ = nullptr;
  void* body_ = nullptr;
  std::vector<std::thread> others_;
  int size_ = 1;
  int waiting_ = 0;
  int64_t generation_ = 0;
  std::atomic<bool> failed_{false};
};

// Hands out [begin, end) in steps to the next thread that asks.
class Queue {
 public:
  void reset(int64_t end, int64_t step) {
    next_.store(0, std::memory_order_relaxed);
    end_ = end;
    step_ = step < 1 ? 1 : step;
  }
  bool take(int64_t& begin, int64_t& end) {
    begin = next_.fetch_add(step_, std::memory_order_relaxed);
    if (begin >= end_) return false;
    end = begin + step_ < end_ ? begin + step_ : end_;
    return true;
  }

 private:
  std::atomic<int64_t> next_{0};
  int64_t end_ = 0, step_ = 1;
};

// Memory that is given back all at once. Throws std::bad_alloc.
class Arena {
 public:
  Arena() = default;
  Arena(const Arena&) = delete;
  Arena& operator=(const Arena&) = delete;
  ~Arena() {
    for (char* chunk : chunks_) std::free(chunk);
  }
  // All that was taken may be overwritten from now on; the memory is kept.
  void rewind() { next_ = left_ = 0; }
  void* take(size_t bytes) {
    bytes = (bytes + 15) & ~size_t{15};
    if (bytes > left_) grow(bytes);
    char* at = cursor_;
    cursor_ += bytes;
    left_ -= bytes;
    return at;
  }

 private:
  void grow(size_t bytes) {
    constexpr size_t kChunk = size_t{1} << 18;
    if (bytes > kChunk) throw std::bad_alloc();  // no record list is near that large
    if (next_ == chunks_.size()) {
      chunks_.push_back(nullptr);
      chunks_[next_] = static_cast<char*>(std::malloc(kChunk));
      if (chunks_[next_] == nullptr) throw std::bad_alloc();
    }
    cursor_ = chunks_[next_++];
    left_ = kChunk;
  }
  std::vector<char*> chunks_;
  char* cursor_ = nullptr;
  size_t left_ = 0, next_ = 0;  // bytes of the chunk at hand; the chunk after it
};

// A buffer without initial values. Throws std::bad_alloc.
template <class T>
class Buffer {
 public:
  Buffer() = default;
  Buffer(const Buffer&) = delete;
  Buffer& operator=(const Buffer&) = delete;
  ~Buffer() { std::free(data_); }
  T* at_least(size_t count) {
    if (count > count_) {
      std::free(data_);
      data_ = static_cast<T*>(std::malloc(count * sizeof(T) + 64));
      count_ = data_ == nullptr ? 0 : count;
      if (data_ == nullptr) throw std::bad_alloc();
    }
    return data_;
  }
  T* data() const { return data_; }

 private:
  T* data_ = nullptr;
  size_t count_ = 0;
};

}  // namespace lw
