"""pyserial URL handler: `serial.serial_for_url('sim://NAME')`.

pyserial imports a module named protocol_<scheme> from each package in `serial.protocol_handler_packages`; the world
appends 'simulated_hw.wire' there when it opens. pyserial hides an ImportError in here behind 'protocol not known'.
"""

from simulated_hw.wire.serial_port import SimulatedSerial


def serial_class_for_url(url: str) -> tuple[str, type[SimulatedSerial]]:
    """The port name and class for a sim:// URL (pyserial's handler interface)."""
    return url, SimulatedSerial
