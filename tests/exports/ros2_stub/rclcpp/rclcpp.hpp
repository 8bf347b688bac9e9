/* Stands in for the calls of rclcpp that a generated node uses: messages come from standard input.
 *
 *   TOPIC NUMBER…     a message of that topic
 *   tick              the timer
 *   set NAME NUMBER…  a parameter
 *   get NAME          what the node answers with
 *
 * What is published and refused goes to standard output, numbers in hexadecimal. Parameters at
 * launch are arguments NAME:=NUMBER,….
 */
#pragma once
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <iostream>
#include <map>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <rcl_interfaces/msg/parameter_descriptor.hpp>
#include <rcl_interfaces/msg/set_parameters_result.hpp>

namespace stub
{
inline std::map<std::string, std::vector<double>> & launch() { static std::map<std::string, std::vector<double>> all; return all; }
inline void print(const char * topic, const std::vector<double> & values)
{
  std::printf("%s", topic);
  for (double value : values) { std::printf(" %a", value); }
  std::printf("\n");
}
inline std::vector<double> numbers(const double & data) { return {data}; }
inline std::vector<double> numbers(const std::uint32_t & data) { return {static_cast<double>(data)}; }
inline std::vector<double> numbers(const std::vector<double> & data) { return data; }
inline void fill(double & data, const std::vector<double> & values) { data = values.at(0); }
inline void fill(std::vector<double> & data, const std::vector<double> & values) { data = values; }
}

namespace rclcpp
{
struct SensorDataQoS {};
struct Logger {};
struct Clock {};

class Parameter
{
public:
  Parameter(std::string name, std::vector<double> values) : name_(std::move(name)), values_(std::move(values)) {}
  const std::string & get_name() const { return name_; }
  double as_double() const { return values_.at(0); }
  std::vector<double> as_double_array() const { return values_; }
private:
  std::string name_;
  std::vector<double> values_;
};

template<typename MessageT> class Publisher
{
public:
  using SharedPtr = std::shared_ptr<Publisher<MessageT>>;
  explicit Publisher(std::string topic) : topic_(std::move(topic)) {}
  void publish(const MessageT & message) { stub::print(topic_.c_str(), stub::numbers(message.data)); }
private:
  std::string topic_;
};
template<typename MessageT> class Subscription
{
public:
  using SharedPtr = std::shared_ptr<Subscription<MessageT>>;
};
class TimerBase
{
public:
  using SharedPtr = std::shared_ptr<TimerBase>;
};
namespace exceptions
{
struct InvalidParameterValueException : std::runtime_error { using std::runtime_error::runtime_error; };
struct InvalidParameterTypeException : std::runtime_error { using std::runtime_error::runtime_error; };
}
namespace node_interfaces
{
struct OnSetParametersCallbackHandle { using SharedPtr = std::shared_ptr<OnSetParametersCallbackHandle>; };
}

class Node
{
public:
  explicit Node(const std::string & name) { std::printf("node %s\n", name.c_str()); }
  virtual ~Node() = default;

  /* As rclcpp: callbacks that are there judge the first value too, and a refused one is not declared. */
  template<typename T>
  T declare_parameter(const std::string & name, const T & value, const rcl_interfaces::msg::ParameterDescriptor & descriptor, bool ignore_override = false)
  {
    if (parameters_.count(name) != 0) { throw std::runtime_error("declared already: " + name); }
    T found = value;
    if (!ignore_override && stub::launch().count(name) != 0) {
      /* no numbers stand for another type, as an integer is where a double is declared */
      if (stub::launch()[name].empty()) {
        throw exceptions::InvalidParameterTypeException("parameter '" + name + "' has invalid type");
      }
      stub::fill(found, stub::launch()[name]);
    }
    if (set_) {
      const auto result = set_({Parameter(name, stub::numbers(found))});
      if (!result.successful) {
        throw exceptions::InvalidParameterValueException("parameter '" + name + "' could not be set: " + result.reason);
      }
    }
    std::printf("parameter %s: %s\n", name.c_str(), descriptor.description.c_str());
    parameters_[name] = stub::numbers(found);
    return found;
  }
  template<typename CallbackT>
  node_interfaces::OnSetParametersCallbackHandle::SharedPtr add_on_set_parameters_callback(CallbackT && callback)
  {
    set_ = callback;
    return std::make_shared<node_interfaces::OnSetParametersCallbackHandle>();
  }
  template<typename MessageT, typename CallbackT>
  typename Subscription<MessageT>::SharedPtr create_subscription(const std::string & topic, const SensorDataQoS &, CallbackT && callback)
  {
    heard_[topic] = [callback](const std::vector<double> & values) {
      MessageT message;
      stub::fill(message.data, values);
      callback(message);
    };
    return std::make_shared<Subscription<MessageT>>();
  }
  template<typename MessageT>
  typename Publisher<MessageT>::SharedPtr create_publisher(const std::string & topic, std::size_t)
  {
    return std::make_shared<Publisher<MessageT>>(topic);
  }
  template<typename RatioT, typename PeriodT, typename CallbackT>
  TimerBase::SharedPtr create_wall_timer(std::chrono::duration<RatioT, PeriodT> period, CallbackT callback)
  {
    std::printf("timer %lld ns\n", static_cast<long long>(std::chrono::nanoseconds(period).count()));
    tick_ = callback;
    return std::make_shared<TimerBase>();
  }
  Logger get_logger() const { return {}; }
  std::shared_ptr<Clock> get_clock() const { return std::make_shared<Clock>(); }

  void run()
  {
    std::string line;
    while (std::getline(std::cin, line)) {
      std::istringstream words(line);
      std::string verb, name, word;
      words >> verb;
      if (verb == "set" || verb == "get") { words >> name; }
      std::vector<double> values;
      while (words >> word) { values.push_back(std::strtod(word.c_str(), nullptr)); }
      if (verb == "tick") {
        tick_();
      } else if (verb == "set") {
        const auto result = set_({Parameter(name, values)});
        if (result.successful) {
          parameters_[name] = values;
        } else {
          std::printf("refused %s\n", result.reason.c_str());
        }
      } else if (verb == "get") {
        stub::print(name.c_str(), parameters_.at(name));
      } else {
        heard_.at(verb)(values);
      }
    }
  }

private:
  /* those that a node of rclcpp has before its own */
  std::map<std::string, std::vector<double>> parameters_ = {{"use_sim_time", {0.0}}, {"start_type_description_service", {1.0}}};
  std::function<rcl_interfaces::msg::SetParametersResult(const std::vector<Parameter> &)> set_;
  std::map<std::string, std::function<void(const std::vector<double> &)>> heard_;
  std::function<void()> tick_;
};

inline void init(int argc, char ** argv)
{
  for (int i = 1; i < argc; i++) {
    const std::string given = argv[i];
    const std::size_t at = given.find(":=");
    std::istringstream words(given.substr(at + 2));
    std::string word;
    std::vector<double> & values = stub::launch()[given.substr(0, at)];
    while (std::getline(words, word, ',')) { values.push_back(std::strtod(word.c_str(), nullptr)); }
  }
}
inline void spin(const std::shared_ptr<Node> & node) { node->run(); }
inline void shutdown() {}
}

#define RCLCPP_ERROR(logger, ...) do { (void)(logger); std::printf("error "); std::printf(__VA_ARGS__); std::printf("\n"); } while (0)
#define RCLCPP_WARN_THROTTLE(logger, clock, every, ...) do { (void)(logger); (void)(clock); (void)(every); std::printf("warning "); std::printf(__VA_ARGS__); std::printf("\n"); } while (0)
