"""A bought I/O board for tests."""

from __future__ import annotations

import asyncio
import threading

from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice


class OtherBoard:
    """A bought I/O board: a Modbus server over TCP that knows of coils and registers and nothing else."""

    def __init__(self, port: int = 0) -> None:
        self.port = port
        self._loop = asyncio.new_event_loop()
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        assert self._ready.wait(10.0)

    def _run(self) -> None:
        self._loop.run_until_complete(self._serve())

    async def _serve(self) -> None:
        coils = [SimData(0, values=[False] * 16, datatype=DataType.BITS)]
        holding = [SimData(0, values=[0, 0, 0, 0xFFFE, 0, 0, 0, 0, 0, 0], datatype=DataType.REGISTERS)]
        inputs = [SimData(0, values=[10132, 9868, 0], datatype=DataType.REGISTERS)]
        discrete = [SimData(0, values=[False] * 16, datatype=DataType.BITS)]
        self.server = ModbusTcpServer(
            SimDevice(1, simdata=(coils, discrete, holding, inputs)), address=("127.0.0.1", self.port)
        )
        await self.server.serve_forever(background=True)
        self.port = self.server.transport.sockets[0].getsockname()[1]
        self._stop = asyncio.Event()
        self._ready.set()
        await self._stop.wait()
        await self.server.shutdown()

    def ask(self, function: int, first: int, count: int) -> list[int]:
        """Return what the board holds, asked from its own thread."""

        async def get() -> list[int]:
            return list(await self.server.async_getValues(1, function, first, count))

        return asyncio.run_coroutine_threadsafe(get(), self._loop).result(5.0)

    def close(self) -> None:
        """Be gone."""
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(5.0)
