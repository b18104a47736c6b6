import weakref

from air_router.vehicle.px4.mavsdk_bridge import destroy


def test_callbacks_outlive_the_threads_that_call_them():
    """MAVSDK forgets them first; what is still on its way is then handed to freed memory."""

    class Callback:
        pass

    class Plugin:
        def __init__(self):
            self._callbacks, self._subscriptions = [Callback()], {1: (Callback(), None)}

    class Mavsdk:
        def destroy(self):
            callbacks = [plugin._callbacks[0], plugin._subscriptions[1][0]]
            references = [weakref.ref(callback) for callback in callbacks]
            del callbacks
            plugin._callbacks.clear()
            plugin._subscriptions.clear()
            alive.extend(reference() is not None for reference in references)

    plugin, alive = Plugin(), []
    destroy(Mavsdk(), [plugin])
    assert alive == [True, True]
